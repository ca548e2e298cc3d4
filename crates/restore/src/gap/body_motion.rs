//! Gaps of a whole body filled from motion that is known: of a library, and of the take itself.

use super::whole_body::bare_frames;
use super::{FilledGap, Gap};
use crate::inbetween::{MotionFiller, Verdict};
use crate::known_motion::{BodyGap, KnownMotion};
use crate::pose::FillMethod;
use crate::take::Take;
use ndarray::s;

/// Fills those gaps of a take that are a whole body's, and lists these; the others are `None`.
pub(crate) fn fill(
    take: &Take<'_>,
    gaps: &[Gap],
    longest: Option<f64>,
) -> (Vec<Option<FilledGap>>, Vec<BodyGap>) {
    let mut out = vec![None; gaps.len()];
    let library = match take.motion {
        KnownMotion::Nothing => return (out, Vec::new()),
        KnownMotion::Own => None,
        KnownMotion::Library(library) => Some(library),
    };
    let bare = bare_frames(take.xyz);
    if !bare.contains(&true) {
        return (out, Vec::new());
    }
    let filler = MotionFiller::new(take.names, take.xyz, take.runs, take.rate, library);
    let Some(mut filler) = filler else {
        return (out, Vec::new());
    };
    let points = filler.points().to_vec();
    let mut bodies = Vec::new();
    for frames in filler.gaps(&bare, longest) {
        let verdict = filler.fill(&frames);
        let body = BodyGap::of(frames, &verdict);
        let fill = match verdict {
            Verdict::Filled(fill) => fill,
            _ => {
                bodies.push(body);
                continue;
            }
        };
        for (k, gap) in gaps.iter().enumerate() {
            let Some(b) = points.iter().position(|p| *p == gap.point) else {
                continue;
            };
            let is_inside =
                body.frames.start <= gap.frames.start && gap.frames.end <= body.frames.end;
            if is_inside {
                let first = gap.frames.start - body.frames.start;
                let rows = first..first + gap.frames.len();
                out[k] = Some(FilledGap {
                    xyz: fill
                        .xyz
                        .slice(s![rows.clone(), 3 * b..3 * b + 3])
                        .to_owned(),
                    variance: fill.variance.slice(s![rows, b]).to_vec(),
                    method: FillMethod::Motion,
                    contacts: Vec::new(),
                });
            }
        }
        bodies.push(body);
    }
    (out, bodies)
}
