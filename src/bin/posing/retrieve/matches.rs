//! The table and the picture of the poses that were found.

use super::Described;
use posing::cli::metric_takes::MetricTakes;
use posing::cli::take_classes::TakeClass;
use posing::draw::figure::strip::{StripPose, strip};
use posing::io::csv::push_cell;
use posing::io::text::{push_f32, push_f64};
use posing::metric::joint_map::SIXTEEN_JOINTS;
use posing::metric::nearest::Neighbor;
use posing::metric::{FrameRef, FrameRows, PoseIndex};
use std::collections::HashMap;

/// Queries and poses found that are drawn, at most.
const PICTURED_QUERIES: usize = 8;
const PICTURED: usize = 10;

/// Poses found, with what is needed to write, judge and draw them.
pub(super) struct Matches<'a> {
    pub sides: [Described<'a>; 2],
    pub query_rows: &'a FrameRows,
    pub rows: &'a FrameRows,
    pub found: &'a [Vec<Neighbor>],
    pub classes: Option<HashMap<String, TakeClass>>,
}

impl Matches<'_> {
    pub fn head(&self) -> &'static [u8] {
        match self.classes {
            Some(_) => b"take,frame,rank,found_take,found_frame,distance,right,found_time\n",
            None => b"take,frame,rank,found_take,found_frame,distance,found_time\n",
        }
    }

    pub fn lines(&self, query: usize) -> Vec<u8> {
        let mut out = Vec::new();
        let [(_, queries), (_, database)] = self.sides;
        for (rank, neighbor) in self.found[query].iter().enumerate() {
            push_frame(&mut out, queries, self.query_rows.frame(query));
            out.push(b',');
            out.extend((rank + 1).to_string().bytes());
            out.push(b',');
            let found = self.rows.frame(neighbor.row);
            push_frame(&mut out, database, found);
            out.push(b',');
            push_f32(&mut out, neighbor.distance);
            if self.classes.is_some() {
                let right = self.is_right(query, neighbor);
                out.extend(
                    right
                        .map_or(String::from(","), |r| format!(",{}", u8::from(r)))
                        .bytes(),
                );
            }
            out.push(b',');
            if let Some(time) = database.takes[found.take].time(found.frame) {
                push_f64(&mut out, time);
            }
            out.push(b'\n');
        }
        out
    }

    /// Whether a pose found is of its query's class; `None` where that is not known.
    fn is_right(&self, query: usize, neighbor: &Neighbor) -> Option<bool> {
        let classes = self.classes.as_ref()?;
        let [(_, queries), (_, database)] = self.sides;
        let wanted = classes.get(&queries.takes[self.query_rows.frame(query).take].name)?;
        let found = classes.get(&database.takes[self.rows.frame(neighbor.row).take].name)?;
        Some(wanted.class == found.class)
    }

    /// The share of right ones among the `scope` nearest, each take of the queries once.
    pub fn precision(&self, scope: usize) -> Option<f64> {
        let mut takes = vec![(0.0, 0.0); self.sides[0].1.takes.len()];
        for (query, found) in self.found.iter().enumerate() {
            let judged = found
                .iter()
                .take(scope)
                .filter_map(|n| self.is_right(query, n));
            for is_right in judged {
                let take = &mut takes[self.query_rows.frame(query).take];
                take.0 += f64::from(u8::from(is_right));
                take.1 += 1.0;
            }
        }
        let shares: Vec<f64> = (takes.iter().filter(|t| t.1 > 0.0))
            .map(|t| t.0 / t.1)
            .collect();
        (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
    }

    /// Some queries and what was found for them, as SVG.
    pub fn picture(&self) -> String {
        let pose = |takes: &MetricTakes, at: FrameRef, distance, is_right| StripPose {
            joints: takes.takes[at.take].frame(at.frame).to_vec(),
            captions: [takes.names[at.take].clone(), format!("frame {}", at.frame)],
            distance,
            is_right,
        };
        let [Some(queries), Some(database)] = self.sides.map(|(table, _)| table) else {
            return String::new();
        };
        let step = self.found.len().div_ceil(PICTURED_QUERIES).max(1);
        let rows = (0..self.found.len()).step_by(step).map(|query| {
            let own = pose(queries, self.query_rows.frame(query), None, None);
            let found = self.found[query].iter().take(PICTURED).map(|n| {
                let at = self.rows.frame(n.row);
                pose(database, at, Some(n.distance), self.is_right(query, n))
            });
            [own].into_iter().chain(found).collect()
        });
        strip(&rows.collect::<Vec<_>>(), SIXTEEN_JOINTS)
    }
}

/// Appends a frame's take and number as two cells.
fn push_frame(out: &mut Vec<u8>, index: &PoseIndex, at: FrameRef) {
    push_cell(out, index.takes[at.take].name.as_bytes());
    out.push(b',');
    out.extend(at.frame.to_string().bytes());
}
