//! A take of markers, solved: its joints, its skeleton and what is to be told of it.

use super::landmarks::JointSet;
use super::plug_in_gait::Centers;
use super::tuning::{FAR, ODD_PLACE};
use super::unseen_limbs::UnseenLimb;
use crate::Result;
use crate::io::csv::{AddedColumn, After};
use crate::io::unit_writer::UnitWriter;
use crate::io::{Asf, Bvh, Output, Table, TableFormat};
use crate::label::unlabeled::{is_computed, is_unlabeled};
use crate::numeric::statistics::median;
use crate::pose::rotation::Axis;
use crate::pose::{Poses, Units};
use glam::DMat3;
use ndarray::Array2;
use serde::Serialize;
use serde_json::json;

/// A take of markers, solved.
#[derive(Debug)]
pub struct SolvedTake {
    /// The joints (frames, 3 J), cm; NaN where too few markers are seen.
    pub joints: Poses,
    /// Standard deviation of a coordinate of each joint (frames, J), cm, if it was asked for.
    pub sd: Option<Array2<f64>>,
    /// The person's skeleton.
    pub skeleton: Asf,
    /// (frames, values of the skeleton), radians and cm; those of a frame that could not be solved
    /// are the ones before.
    pub values: Array2<f64>,
    /// The name of the marker set.
    pub set: String,
    /// Whose the joint centers are.
    pub centers: Centers,
    /// The markers that were used.
    pub used: Vec<UsedMarker>,
    /// Markers of the static take alone, which were used for bones.
    pub of_static: Vec<String>,
    /// The points of the take that were not used.
    pub left_out: Vec<String>,
    /// The limbs that no marker shows.
    pub unseen: Vec<UnseenLimb>,
    /// Frames without joints.
    pub unsolved: usize,
    /// Frames whose pose was not settled after many steps.
    pub unsettled: usize,
}

/// A marker that was used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UsedMarker {
    /// The marker's name.
    pub name: String,
    /// The bone that it is on.
    pub bone: String,
    /// How far it is from its position on its bone, cm: the mean over the frames.
    pub distance: f64,
    /// How far that position is from where such a marker is mostly, standard deviations.
    pub deviations: f64,
    /// The marker on the other side of its bone that it changes places with: each is where the
    /// other mostly is.
    pub exchanged_with: Option<String>,
}

impl UsedMarker {
    /// Whether its name may be wrong.
    pub fn is_suspect(&self) -> bool {
        self.deviations >= ODD_PLACE || self.distance >= FAR || self.exchanged_with.is_some()
    }

    fn finding(&self) -> String {
        if let Some(other) = &self.exchanged_with {
            return format!(
                "{} is where {other} mostly is, which is in its place",
                self.name
            );
        }
        format!(
            "{} does not fit its name: it is {:.1} standard deviations from where such markers \
             are, and {:.1} cm from its place in the mean; is it another?",
            self.name, self.deviations, self.distance
        )
    }
}

/// Where more than one in so many markers do not fit, it is none of them that is wrong.
const MOST: usize = 3;
/// Points that a line names.
const NAMED: usize = 5;
/// Where one in so many labels is none of the set's markers, or more are, it may be another set.
const MANY_UNKNOWN: usize = 3;

/// Says which points are none of the set's markers.
fn not_of_set(points: &[String]) -> String {
    let shown = points[..points.len().min(NAMED)].join(", ");
    let more = match points.len().saturating_sub(NAMED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    format!(
        "{} points are none of its markers and not used: {shown}{more}",
        points.len()
    )
}

impl SolvedTake {
    /// Which markers were used, a line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "{} markers of the set {}",
            self.used.len(),
            self.set
        )];
        if !self.of_static.is_empty() {
            let names = self.of_static.join(", ");
            lines.push(format!("of the static take alone: {names}"));
        }
        if !self.left_out.is_empty() && self.unknown().is_none() {
            lines.push(not_of_set(&self.left_out));
        }
        lines.extend(self.centers.line());
        lines
    }

    /// The labels that the set does not know, where they are a good part of all.
    fn unknown(&self) -> Option<Vec<String>> {
        let is_label = |name: &&String| !is_unlabeled(name) && !is_computed(name, &self.left_out);
        let unknown: Vec<String> = self.left_out.iter().filter(is_label).cloned().collect();
        let all = self.used.len() + unknown.len();
        (MANY_UNKNOWN * unknown.len() >= all && !unknown.is_empty()).then_some(unknown)
    }

    /// What programs want to know of it: the set, the markers and how they fit, the lengths of the
    /// bones, cm, and how many frames have no joints.
    pub fn report(&self) -> serde_json::Value {
        let bones = self.skeleton.skeleton.bones().iter();
        let lengths = bones.map(|b| (b.name.clone(), json!(b.offset.length())));
        let mut report = json!({
            "set": self.set,
            "markers": self.used,
            "of_static": self.of_static,
            "left_out": self.left_out,
            "unseen_limbs": self.unseen,
            "bones": lengths.collect::<serde_json::Map<_, _>>(),
            "frames": self.joints.frames(),
            "unsolved": self.unsolved,
            "unsettled": self.unsettled,
            "findings": self.findings(),
        });
        if JointSet::of(&self.joints.points) == JointSet::Anatomical {
            report["centers"] = json!(self.centers.name());
        }
        if let Some(sd) = &self.sd {
            let median = |j: usize| {
                let known = sd.column(j).into_iter().copied();
                median(known.filter(|v| v.is_finite()).collect())
            };
            let names = self.joints.points.iter().enumerate();
            let medians = names.map(|(j, name)| (name.clone(), json!(median(j))));
            report["sd"] = medians.collect::<serde_json::Map<_, _>>().into();
        }
        report
    }

    /// The joints as a pose table (CSV), with columns NAME.sd where there are deviations.
    ///
    /// # Errors
    /// Those of writing.
    pub fn write_table(&self, output: Output) -> Result<()> {
        let (units, table) = ([Units::CM_Y; 2], Table::from_poses(self.joints.clone()));
        let added = self.sd_columns();
        UnitWriter::new(output, TableFormat::Csv, units, &table.columns, &added)?.write_table(
            &table,
            self.joints.xyz.view(),
            |t| self.sd_cells(t),
        )
    }

    /// The columns of deviations in a table of the joints; none without any.
    #[doc(hidden)]
    pub fn sd_columns(&self) -> Vec<AddedColumn> {
        let names = self.joints.points.iter().enumerate();
        let own = names.map(|(p, n)| AddedColumn::new(format!("{n}.sd"), After::Point(p)));
        own.filter(|_| self.sd.is_some()).collect()
    }

    /// The cells of these columns in a frame.
    #[doc(hidden)]
    pub fn sd_cells(&self, frame: usize) -> Vec<String> {
        let row = self.sd.iter().flat_map(|sd| sd.row(frame).to_vec());
        row.map(|sd| {
            if sd.is_finite() {
                format!("{sd:.4}")
            } else {
                String::new()
            }
        })
        .collect()
    }

    /// What somebody should look at, a line each.
    pub fn findings(&self) -> Vec<String> {
        let suspects: Vec<&UsedMarker> = self.used.iter().filter(|m| m.is_suspect()).collect();
        let mut lines: Vec<String> = self.unseen.iter().map(UnseenLimb::sentence).collect();
        let odd: Vec<String> = if MOST * suspects.len() > self.used.len() {
            vec![format!(
                "{} of {} markers do not fit their names: are those of the pelvis right, and is \
             the set?",
                suspects.len(),
                self.used.len()
            )]
        } else {
            suspects.iter().map(|m| m.finding()).collect()
        };
        lines.extend(odd);
        lines.extend(self.unknown().map(|unknown| not_of_set(&unknown)));
        match self.unsolved {
            0 => {}
            n if n == self.joints.frames() => {
                lines.push("no frame has three markers: there are no joints".to_string());
            }
            n => lines.push(format!("{n} frames have too few markers: no joints there")),
        }
        if self.unsettled > 0 {
            let n = self.unsettled;
            lines.push(format!(
                "the poses of {n} frames are not settled after many steps"
            ));
        }
        lines
    }

    /// Skeleton and motion as a BVH, y up, at `rate` frames a second.
    ///
    /// # Errors
    /// None for values that [`solve`](super::solve) made.
    pub fn to_bvh(&self, rate: f64) -> Result<Bvh> {
        let order = [Axis::Z, Axis::Y, Axis::X];
        let skeleton = &self.skeleton.skeleton;
        Bvh::from_values(
            skeleton,
            self.values.view(),
            order,
            DMat3::IDENTITY,
            1.0 / rate,
        )
    }
}
