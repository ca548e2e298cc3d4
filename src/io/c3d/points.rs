//! The points of the frames of a C3D file.

use super::header::Layout;
use ndarray::Array2;

/// The points, (frames, 3 P) in the file's unit; NaN where a point is invalid.
pub fn read(bytes: &[u8], layout: &Layout) -> Array2<f64> {
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

/// A point; `None` where its residual is -1, or it is no number.
pub fn decode(bytes: &[u8], layout: &Layout) -> Option<[f64; 3]> {
    let width = layout.number_bytes();
    let number = |i: usize| {
        let b = &bytes[i * width..];
        match layout.real {
            true => f64::from(layout.processor.f32([b[0], b[1], b[2], b[3]])),
            false => f64::from(layout.processor.u16([b[0], b[1]]) as i16),
        }
    };
    let scale = if layout.real { 1.0 } else { layout.scale };
    let point = [0, 1, 2].map(|c| number(c) * scale);
    (number(3) != -1.0 && point.iter().all(|v| v.is_finite())).then_some(point)
}

/// The bytes of a point with a residual of 0, as is written for points that were not measured, or of an invalid one (`None`).
///
/// # Errors
/// The coordinate that 16 bits do not hold at the file's scale.
pub fn encode(point: Option<[f64; 3]>, layout: &Layout) -> Result<Vec<u8>, f64> {
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
