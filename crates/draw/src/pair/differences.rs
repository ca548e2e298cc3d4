//! How far apart the points of two takes are that have the same names.

use ndarray::ArrayView2;

/// Points farther than this from the origin (cm, 100 km) count as missing.
const MAX_COORDINATE: f64 = 1e7;

/// The differences of the points of a frame, cm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameDifference {
    /// Root mean square over the points.
    pub rms: f64,
    /// The largest.
    pub largest: f64,
    /// The point that has it.
    pub point: usize,
}

/// The differences of a point over the frames that are compared, cm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointDifference {
    /// The point.
    pub point: usize,
    /// Root mean square over the frames.
    pub rms: f64,
    /// The largest.
    pub largest: f64,
    /// The frame that has it.
    pub frame: usize,
}

/// The differences of two takes.
#[derive(Debug, Clone, PartialEq)]
pub struct Differences {
    /// Those of each frame; `None` where no point can be compared.
    pub frames: Vec<Option<FrameDifference>>,
    /// Those of each point that can be compared, the largest first.
    pub points: Vec<PointDifference>,
}

impl Differences {
    /// Compares `shared` points of two takes (frames, 3 P; cm). `compared` has for each frame the
    /// one whose differences it shows.
    pub(super) fn new(
        xyz: [ArrayView2<'_, f64>; 2],
        shared: &[usize],
        compared: &[Option<usize>],
    ) -> Differences {
        let axes = axes(&xyz);
        let mut frames = vec![None; compared.len()];
        let mut points: Vec<(usize, Sum)> = shared.iter().map(|p| (*p, Sum::default())).collect();
        let mut own: Vec<usize> = compared.iter().flatten().copied().collect();
        own.dedup();
        for frame in own {
            let mut of_frame = Sum::default();
            for (point, of_point) in &mut points {
                if let Some(distance) = distance(&xyz, &axes, frame, *point) {
                    of_frame.add(distance, *point);
                    of_point.add(distance, frame);
                }
            }
            frames[frame] = of_frame.rms().map(|rms| FrameDifference {
                rms,
                largest: of_frame.largest,
                point: of_frame.at,
            });
        }
        let told = compared.iter().map(|at| frames[(*at)?]).collect();
        let points = points.into_iter().filter_map(|(point, sum)| {
            Some(PointDifference {
                point,
                rms: sum.rms()?,
                largest: sum.largest,
                frame: sum.at,
            })
        });
        let mut points: Vec<PointDifference> = points.collect();
        points.sort_by(|a, b| b.largest.total_cmp(&a.largest));
        Differences {
            frames: told,
            points,
        }
    }
}

/// Distances that are summed, and where the largest is.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    squares: f64,
    count: f64,
    largest: f64,
    at: usize,
}

impl Sum {
    fn add(&mut self, distance: f64, at: usize) {
        if self.count == 0.0 || distance > self.largest {
            (self.largest, self.at) = (distance, at);
        }
        self.squares += distance * distance;
        self.count += 1.0;
    }

    fn rms(&self) -> Option<f64> {
        (self.count > 0.0).then(|| (self.squares / self.count).sqrt())
    }
}

/// The axes that both takes have: of a 2-D capture one is missing throughout.
fn axes(xyz: &[ArrayView2<'_, f64>; 2]) -> Vec<usize> {
    let has = |xyz: &ArrayView2<'_, f64>, axis: usize| {
        let mut columns = xyz.columns().into_iter().skip(axis).step_by(3);
        columns.any(|column| column.iter().any(|v| v.is_finite()))
    };
    let is_shared = |axis: &usize| xyz.iter().all(|xyz| has(xyz, *axis));
    (0..3).filter(is_shared).collect()
}

/// How far apart a point is; `None` where it is missing in one.
fn distance(
    xyz: &[ArrayView2<'_, f64>; 2],
    axes: &[usize],
    frame: usize,
    point: usize,
) -> Option<f64> {
    let mut square = 0.0;
    for axis in axes {
        let [a, b] = [0, 1].map(|take| xyz[take][[frame, 3 * point + axis]]);
        if !(a.abs() <= MAX_COORDINATE && b.abs() <= MAX_COORDINATE) {
            return None;
        }
        square += (a - b).powi(2);
    }
    (!axes.is_empty()).then(|| square.sqrt())
}
