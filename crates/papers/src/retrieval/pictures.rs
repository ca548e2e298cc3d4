//! Poses found by distances, drawn beside their queries.

use super::score;
use super::takes::TakeSet;
use crate::draw::figure::strip::{StripPose, strip};
use crate::metric::joint_map::SIXTEEN_JOINTS;
use crate::metric::{FrameRef, PoseDatabase, PoseMetric};

/// Queries of one picture, and poses found for each.
const QUERIES: usize = 4;
const FOUND: usize = 8;

/// For each distance, the poses of `searched` found for poses amid takes of `queries`, as SVG with
/// headings.
pub(crate) fn draw(
    metrics: &[(String, PoseMetric)],
    searched: &TakeSet,
    queries: &TakeSet,
) -> String {
    let step = (queries.takes.len() / QUERIES).max(1);
    let asked: Vec<FrameRef> = (0..queries.takes.len())
        .step_by(step)
        .take(QUERIES)
        .map(|take| FrameRef {
            take,
            frame: queries.takes[take].frames() / 2,
        })
        .collect();
    let mut out = String::new();
    for (name, metric) in metrics {
        let rows = rows(metric, searched, queries, &asked);
        out += &format!(
            "<h3>{}</h3><figure class=\"wide\">{}</figure>",
            crate::draw::html::escape(name),
            strip(&rows, SIXTEEN_JOINTS)
        );
    }
    out
}

fn rows(
    metric: &PoseMetric,
    searched: &TakeSet,
    queries: &TakeSet,
    asked: &[FrameRef],
) -> Vec<Vec<StripPose>> {
    let (at, vectors) = metric.embed_takes(&searched.takes, score::step);
    let database = PoseDatabase::new(vectors, metric.norm);
    let pose = |set: &TakeSet, at: FrameRef, judged: Option<(&str, f32)>| StripPose {
        joints: set.takes[at.take].frame(at.frame).to_vec(),
        captions: [
            set.about[at.take].class.clone(),
            format!("frame {}", at.frame),
        ],
        distance: judged.map(|(_, distance)| distance),
        is_right: judged.map(|(class, _)| set.about[at.take].class == class),
    };
    let row = |query: &FrameRef| {
        let vector = metric.embed_frames(&queries.takes[query.take], &[query.frame]);
        let found = database.nearest(vector.view(), FOUND, |_, _| true).concat();
        let class = &queries.about[query.take].class;
        let found = found
            .iter()
            .map(|n| pose(searched, at[n.row], Some((class, n.distance))));
        [pose(queries, *query, None)]
            .into_iter()
            .chain(found)
            .collect()
    };
    asked.iter().map(row).collect()
}
