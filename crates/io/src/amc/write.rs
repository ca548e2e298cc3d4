//! Takes written.

use super::Asf;
use crate::text::push_f64;

/// The head of an AMC file, in degrees as CMU's are.
pub(super) fn write_header(out: &mut Vec<u8>) {
    out.extend_from_slice(b":FULLY-SPECIFIED\n:DEGREES\n");
}

/// Appends one frame in degrees and raw units. Ten decimals: a millionth of a millimeter at arm's
/// length.
pub(super) fn write_frame(out: &mut Vec<u8>, asf: &Asf, number: u64, values: &[f64]) {
    use std::io::Write;
    // Writing to memory cannot fail.
    let _ = writeln!(out, "{number}");
    for (i, bone) in asf.skeleton.bones().iter().enumerate() {
        if bone.dofs.is_empty() {
            continue;
        }
        out.extend_from_slice(bone.name.as_bytes());
        for (dof, &value) in bone.dofs.iter().zip(&values[asf.skeleton.dofs_of(i)]) {
            let value = if dof.channel.is_angle() {
                value.to_degrees()
            } else {
                value / asf.unit
            };
            out.push(b' ');
            let rounded = (value * 1e10).round() / 1e10;
            push_f64(
                out,
                if rounded.is_finite() {
                    rounded + 0.0
                } else {
                    value
                },
            );
        }
        out.push(b'\n');
    }
}
