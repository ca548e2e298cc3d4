//! Writing TRC files.

use crate::text::{push_f64, push_integer};
use crate::{Error, Result};
use ndarray::ArrayView2;

/// What a new file says of its points.
#[derive(Debug, Clone)]
pub(crate) struct NewTrc<'a> {
    /// The name in the file's first line.
    pub name: &'a str,
    /// The points' names (P).
    pub points: &'a [String],
    /// Frames a second.
    pub rate: f64,
    /// The number of the first frame, from 1.
    pub first_frame: u32,
    /// The times of the frames in seconds; `None`: they follow from the first frame's number and
    /// the rate.
    pub times: Option<&'a [f64]>,
    /// The unit of length, such as `mm`.
    pub units: &'a str,
}

impl NewTrc<'_> {
    /// The bytes of a file with these points (frames, 3 P; NaN: an empty cell). A tab ends every
    /// row: OpenSim counts an empty last cell only then.
    ///
    /// # Errors
    /// [`Error::Usage`]: no points or frames, or a name that the format cannot hold.
    pub(crate) fn bytes(&self, xyz: ArrayView2<'_, f64>) -> Result<Vec<u8>> {
        if self.points.is_empty() || xyz.nrows() == 0 {
            let what = "TRC files need at least one point and one frame";
            return Err(Error::usage(what));
        }
        let is_bad = |name: &&String| name.trim().is_empty() || name.contains(char::is_control);
        if let Some(name) = self.points.iter().find(is_bad) {
            let what = format!("a TRC file cannot hold the name {name:?} of a point");
            return Err(Error::usage(what));
        }
        let mut out = self.head(xyz.nrows());
        for (t, row) in xyz.rows().into_iter().enumerate() {
            let number = self.first_frame.saturating_add(t as u32);
            push_integer(&mut out, number);
            out.push(b'\t');
            let time = self.times.and_then(|times| times.get(t));
            let by_number = (f64::from(number) - 1.0) / self.rate;
            push_f64(&mut out, time.copied().unwrap_or(by_number));
            for value in row {
                out.push(b'\t');
                push_f64(&mut out, *value);
            }
            out.extend(b"\t\n");
        }
        Ok(out)
    }

    fn head(&self, frames: usize) -> Vec<u8> {
        let mut rate = Vec::new();
        push_f64(&mut rate, self.rate);
        let rate = String::from_utf8_lossy(&rate);
        let (points, units, first) = (self.points.len(), self.units, self.first_frame);
        let name = self.name.replace(char::is_control, " ");
        let mut head = format!(
            "PathFileType\t4\t(X/Y/Z)\t{name}\n\
             DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\t\
             OrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
             {rate}\t{rate}\t{frames}\t{points}\t{units}\t{rate}\t{first}\t{frames}\n\
             Frame#\tTime\t"
        );
        for point in self.points {
            head += &format!("{point}\t\t\t");
        }
        head += "\n\t\t";
        for i in 1..=points {
            head += &format!("X{i}\tY{i}\tZ{i}\t");
        }
        head += "\n\n";
        head.into_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Input, trc};
    use ndarray::array;

    #[test]
    fn what_is_written_reads_back() {
        let points = ["A".to_string(), "B 2".to_string()];
        let xyz = array![
            [0.1, -2.0, 3e-7, f64::NAN, f64::NAN, f64::NAN],
            [1.0 / 3.0, 0.0, 1e20, 4.0, 5.0, 6.0]
        ];
        let new = NewTrc {
            name: "a\tb",
            points: &points,
            rate: 100.0,
            first_frame: 31,
            times: Some(&[3.38, 3.39]),
            units: "mm",
        };
        let bytes = new.bytes(xyz.view()).unwrap();
        let lines = String::from_utf8(bytes.clone()).unwrap();
        // Two cells of the frame, six of the points, and a tab at the end.
        assert_eq!(lines.lines().nth(6).unwrap().matches('\t').count(), 8);
        let input = Input::new("x", std::io::Cursor::new(bytes)).unwrap();
        let take = trc::read(input, false).unwrap();
        assert_eq!((&take.points[..], take.first_frame), (&points[..], 31));
        assert_eq!(
            (take.rate, take.units.as_deref()),
            (Some(100.0), Some("mm"))
        );
        assert!(take.notes.is_empty());
        assert_eq!(take.times.as_deref(), Some(&[3.38, 3.39][..]));
        for (a, b) in take.xyz.iter().zip(&xyz) {
            assert!(a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan());
        }
        let bad = NewTrc {
            points: &["a\tb".to_string()],
            ..new
        };
        assert!(bad.bytes(array![[1.0, 2.0, 3.0]].view()).is_err());
    }
}
