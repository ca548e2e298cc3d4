//! Which points of a table a skeleton knows, and a fit told in lines.

use super::sequence::SequenceFit;
use crate::pose::Poses;
use ndarray::Array2;

/// How many names a line lists.
const LISTED: usize = 8;

/// The points of a table that are joints of a skeleton.
#[derive(Debug, Clone, Default)]
pub struct Correspondence {
    /// The bone of each.
    pub joints: Vec<usize>,
    /// The points' names.
    pub names: Vec<String>,
    /// Their columns: (frames, 3 of each), centimetres.
    pub xyz: Array2<f64>,
    /// The names of points that are no joints.
    pub unmatched: Vec<String>,
}

/// Keeps the points for which `joints` gives a bone.
pub fn match_points(poses: &Poses, joints: &[Option<usize>]) -> Correspondence {
    let mut out = Correspondence::default();
    let mut columns = Vec::new();
    for (k, (name, joint)) in poses.points.iter().zip(joints).enumerate() {
        match *joint {
            Some(bone) => {
                out.joints.push(bone);
                out.names.push(name.clone());
                columns.extend([3 * k, 3 * k + 1, 3 * k + 2]);
            }
            None => out.unmatched.push(name.clone()),
        }
    }
    out.xyz = poses.xyz.select(ndarray::Axis(1), &columns);
    out
}

impl Correspondence {
    /// What the user should know of the match.
    pub fn notes(&self, table: &str) -> Vec<String> {
        if self.unmatched.is_empty() {
            return Vec::new();
        }
        let count = self.unmatched.len();
        let mut names = self.unmatched[..count.min(LISTED)].join(", ");
        if count > LISTED {
            names.push_str(", ...");
        }
        let points = if count == 1 {
            "1 point is"
        } else {
            &format!("{count} points are")
        };
        vec![format!(
            "{table}: {points} no joint of the skeleton and left out: {names}"
        )]
    }
}

impl SequenceFit {
    /// What the user should know of the fit; `names` are the points'.
    pub fn notes(&self, names: &[String]) -> Vec<String> {
        let frames = |n: usize| {
            if n == 1 {
                "1 frame".into()
            } else {
                format!("{n} frames")
            }
        };
        let mut lines = Vec::new();
        match self.worst {
            Some((frame, point)) => lines.push(format!(
                "fit: mean {} cm, max {} cm ({} in row {})",
                length(self.mean),
                length(self.max),
                names.get(point).map_or("?", String::as_str),
                frame + 1
            )),
            None => lines.push("fit: no point is there to fit; the pose is the rest pose".into()),
        }
        if self.incomplete > 0 {
            lines.push(format!(
                "{} had missing points; hidden joints hold their last pose",
                frames(self.incomplete)
            ));
        }
        if self.unplaced > 0 {
            lines.push(format!(
                "{} did not place the root, which stays where it was",
                frames(self.unplaced)
            ));
        }
        if self.unconverged > 0 {
            lines.push(format!(
                "{} did not converge; their values are the best found",
                frames(self.unconverged)
            ));
        }
        lines
    }
}

/// Four decimals, or fewer figures of something smaller.
fn length(cm: f64) -> String {
    if cm < 1e-4 {
        format!("{cm:.0e}")
    } else {
        format!("{cm:.4}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_matched_by_name() {
        let poses = Poses {
            points: ["a", "b", "c"].map(String::from).to_vec(),
            xyz: Array2::from_shape_fn((1, 9), |(_, j)| j as f64),
            ..Poses::default()
        };
        let m = match_points(&poses, &[Some(1), None, Some(0)]);
        assert_eq!(m.names, ["a", "c"]);
        assert_eq!(m.xyz.as_slice().unwrap(), [0., 1., 2., 6., 7., 8.]);
        assert_eq!(m.notes("t").len(), 1);
        assert!(m.notes("t")[0].contains("1 point is no joint") && m.notes("t")[0].ends_with("b"));
    }

    #[test]
    fn a_fit_is_told() {
        let fit = SequenceFit {
            mean: 0.5,
            max: 2.0,
            worst: Some((6, 0)),
            incomplete: 1,
            ..SequenceFit::default()
        };
        let lines = fit.notes(&["lfoot".into()]);
        assert_eq!(
            lines[0],
            "fit: mean 0.5000 cm, max 2.0000 cm (lfoot in row 7)"
        );
        assert_eq!(lines.len(), 2);
        assert!(SequenceFit::default().notes(&[])[0].contains("no point"));
    }
}
