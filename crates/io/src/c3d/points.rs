//! The points of the frames of a C3D file.

use super::header::Layout;
use ndarray::Array2;

/// The points, (frames, 3 P) in the file's unit; NaN where a point is invalid.
pub(crate) fn read(bytes: &[u8], layout: &Layout) -> Array2<f64> {
    let mut xyz = Array2::from_elem((layout.frames, 3 * layout.points), f64::NAN);
    for t in 0..layout.frames {
        for p in 0..layout.points {
            let point = &bytes[layout.point_at(t, p)..][..4 * layout.number_bytes()];
            if let Some(point) = decode(point, layout) {
                (0..3).for_each(|c| xyz[[t, 3 * p + c]] = point[c]);
            }
        }
    }
    xyz
}

/// A point; `None` where its fourth word is below zero, whatever its value, or it or a coordinate
/// is no number. (Makers write -1, -32768, or set the sign bit beside cameras and residual. A real
/// of -0 is not below zero: it is a residual of 0.)
pub(crate) fn decode(bytes: &[u8], layout: &Layout) -> Option<[f64; 3]> {
    let width = layout.number_bytes();
    let number = |i: usize| {
        let b = &bytes[i * width..];
        if layout.real {
            f64::from(layout.processor.f32([b[0], b[1], b[2], b[3]]))
        } else {
            f64::from(layout.processor.u16([b[0], b[1]]) as i16)
        }
    };
    let scale = if layout.real { 1.0 } else { layout.scale };
    let point = [0, 1, 2].map(|c| number(c) * scale);
    let is_hidden = number(3) < 0.0 || number(3).is_nan();
    (!is_hidden && point.iter().all(|v| v.is_finite())).then_some(point)
}

/// The bytes of a point with a residual of 0, as is written for points that were not measured, or
/// of an invalid one (`None`).
///
/// # Errors
/// The coordinate that 16 bits do not hold at the file's scale.
pub(crate) fn encode(point: Option<[f64; 3]>, layout: &Layout) -> Result<Vec<u8>, f64> {
    let numbers = match point {
        Some([x, y, z]) => [x, y, z, 0.0],
        None => [0.0, 0.0, 0.0, -1.0],
    };
    let mut bytes = Vec::new();
    for (i, value) in numbers.into_iter().enumerate() {
        if layout.real {
            bytes.extend(layout.processor.f32_bytes(value as f32));
            continue;
        }
        let steps = if i < 3 {
            (value / layout.scale).round()
        } else {
            value
        };
        if !(f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&steps) {
            return Err(value);
        }
        bytes.extend(layout.processor.u16_bytes(steps as i16 as u16));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::super::numbers::Processor;
    use super::*;

    #[test]
    fn a_fourth_word_below_zero_is_missing() {
        let mut layout = Layout {
            processor: Processor::Intel,
            real: true,
            scale: 0.1,
            points: 1,
            analog: 0,
            start: 0,
            frames: 1,
            first_frame: 1,
            rate: 100.0,
        };
        let is_there = |fourth: f32, layout: &Layout| {
            let numbers = [1.0, 2.0, 3.0, fourth];
            let bytes: Vec<u8> = if layout.real {
                numbers.iter().flat_map(|v| v.to_le_bytes()).collect()
            } else {
                (numbers.iter().flat_map(|v| (*v as i16).to_le_bytes())).collect()
            };
            let point = decode(&bytes, layout);
            // What stays as it was is written with all of its bytes elsewhere; a missing one is
            // written as -1.
            let encoded = encode(point, layout).unwrap();
            assert_eq!(decode(&encoded, layout), point);
            point.is_some()
        };
        for real in [true, false] {
            layout.real = real;
            for hidden in [-1.0, -32768.0, -32640.0, -257.0] {
                assert!(!is_there(hidden, &layout), "{hidden}, {real}");
            }
            for seen in [0.0, -0.0, 1.0, 32767.0] {
                assert!(is_there(seen, &layout), "{seen}, {real}");
            }
        }
        layout.real = true;
        assert!(!is_there(-0.5, &layout) && !is_there(f32::NAN, &layout));
    }
}
