//! The analog channels of a C3D file: what force plates, muscles and other sensors gave.

use super::C3d;
use super::header::Layout;
use super::parameters::Parameters;
use ndarray::Array2;

/// The samples of all analog channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Analog {
    /// The channels' labels, one a channel, some of them empty.
    pub labels: Vec<String>,
    /// The channels' units (`N`, `Nmm`, `V`), one a channel, some of them empty.
    pub units: Vec<String>,
    /// Samples of a channel a frame of the points, at least 1.
    pub per_frame: usize,
    /// (samples, channels), in the channels' units.
    pub values: Array2<f64>,
}

impl C3d {
    /// The analog channels; `None` where the file has none, or a frame's values are no whole
    /// number of samples of each.
    ///
    /// A value is (number - ANALOG:OFFSET) times ANALOG:SCALE times ANALOG:GEN_SCALE.
    ///
    /// ```
    /// use posing_io::C3d;
    ///
    /// let file = C3d::open("../../testdata/examples/biomechanist/gait.c3d")?;
    /// assert!(file.analog().is_none());
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    pub fn analog(&self) -> Option<Analog> {
        let (layout, parameters) = (&self.layout, &self.parameters);
        let channels = parameters.number("ANALOG:USED").unwrap_or(0.0) as usize;
        if channels == 0 || layout.analog == 0 || layout.analog % channels != 0 {
            return None;
        }
        let per_frame = layout.analog / channels;
        let (scales, offsets) = scales(parameters, channels);
        let is_unsigned = parameters.text("ANALOG:FORMAT") == Some("UNSIGNED");
        let values = Array2::from_shape_fn((layout.frames * per_frame, channels), |(s, c)| {
            let at = s % per_frame * channels + c;
            let number = number(&self.bytes, layout, s / per_frame, at, is_unsigned);
            (number - offsets[c]) * scales[c]
        });
        let texts = |name: &str| {
            let mut texts: Vec<String> = parameters.all_texts(name).map(str::to_string).collect();
            texts.resize(channels, String::new());
            texts
        };
        Some(Analog {
            labels: texts("ANALOG:LABELS"),
            units: texts("ANALOG:UNITS"),
            per_frame,
            values,
        })
    }
}

/// The scale and the offset of each channel; 1 and 0 where the file does not say.
fn scales(parameters: &Parameters, channels: usize) -> (Vec<f64>, Vec<f64>) {
    let general = parameters.number("ANALOG:GEN_SCALE").unwrap_or(1.0);
    let mut scales = parameters.all_numbers("ANALOG:SCALE");
    scales.resize(channels, 1.0);
    scales.iter_mut().for_each(|scale| *scale *= general);
    let is_unsigned = parameters.text("ANALOG:FORMAT") == Some("UNSIGNED");
    let mut offsets = parameters.all_numbers("ANALOG:OFFSET");
    offsets.resize(channels, 0.0);
    // Parameters are read without their sign.
    for offset in offsets
        .iter_mut()
        .filter(|o| !is_unsigned && **o > 32_767.0)
    {
        *offset -= 65_536.0;
    }
    (scales, offsets)
}

/// The analog value `at` of a frame, as it is stored.
fn number(bytes: &[u8], layout: &Layout, frame: usize, at: usize, is_unsigned: bool) -> f64 {
    let first = layout.point_at(frame, layout.points) + at * layout.number_bytes();
    let b = &bytes[first..];
    if layout.real {
        return f64::from(layout.processor.f32([b[0], b[1], b[2], b[3]]));
    }
    let word = layout.processor.u16([b[0], b[1]]);
    if is_unsigned {
        f64::from(word)
    } else {
        f64::from(word as i16)
    }
}

#[cfg(test)]
pub(super) mod testdata {
    use super::super::numbers::Processor;
    use super::*;
    use crate::MarkerTake;

    /// A file of two frames without points whose channels have these parameters (group, name,
    /// reals) and 16-bit numbers.
    pub(crate) fn file(parameters: &[(u8, &str, &[f32])], texts: &[u8], words: &[u16]) -> C3d {
        let mut section = vec![1, 0x50, 1, 84];
        section.extend(b"\x06\xffANALOG\x03\0\0\x0e\xfeFORCE_PLATFORM\x03\0\0");
        section.extend(b"\x05\xfdEVENT\x03\0\0");
        for (group, name, values) in parameters {
            section.extend([name.len() as u8, *group]);
            section.extend(name.bytes());
            section.extend((4 * values.len() as u16 + 6).to_le_bytes());
            section.extend([4, 1, values.len() as u8]);
            values.iter().for_each(|v| section.extend(v.to_le_bytes()));
            section.push(0);
        }
        section.extend([texts, &[0, 0]].concat());
        let layout = Layout {
            processor: Processor::Intel,
            real: false,
            scale: 0.1,
            points: 0,
            analog: words.len() / 2,
            start: 0,
            frames: 2,
            first_frame: 1,
            rate: 100.0,
        };
        C3d {
            take: MarkerTake::default(),
            bytes: words.iter().flat_map(|w| w.to_le_bytes()).collect(),
            layout,
            parameters: Parameters::read(&section, Processor::Intel),
        }
    }

    #[test]
    fn values_are_scaled_and_have_their_sign() {
        let parameters: [(u8, &str, &[f32]); 4] = [
            (1, "USED", &[2.0]),
            (1, "SCALE", &[0.5, 2.0]),
            (1, "GEN_SCALE", &[10.0]),
            (1, "OFFSET", &[65_535.0, 4.0]),
        ];
        // Two samples of two channels a frame.
        let words = [0, 4, 65_534, 5, 1, 6, 2, 7];
        let analog = file(&parameters, b"", &words).analog().unwrap();
        let right = ndarray::array![[5.0, 0.0], [-5.0, 20.0], [10.0, 40.0], [15.0, 60.0]];
        assert!(analog.per_frame == 2 && analog.values == right);
        assert_eq!(analog.labels, ["", ""]);
        let unsigned = b"\x06\x01FORMAT\x0e\0\xff\x01\x08UNSIGNED\0";
        let analog = file(&parameters, unsigned, &words).analog().unwrap();
        assert_eq!(analog.values[[1, 0]], -5.0);
        // Three channels of four values, and none.
        assert!(file(&[(1, "USED", &[3.0])], b"", &words).analog().is_none());
        assert!(file(&[], b"", &words).analog().is_none());
    }
}
