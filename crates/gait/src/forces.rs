//! The forces of a file's plates sample by sample, as a table and as OpenSim's external loads.

use crate::io::text::push_f64;
use crate::io::{C3d, opensim};
use crate::plate::Plate;
use crate::pose::{LengthUnit, UpAxis};
use crate::{Error, Place, Result};
use glam::DVec3;

/// With less along the vertical, N, the center of pressure is noise.
const LEAST: f64 = 10.0;
/// Values are written to so many parts of a unit.
const PARTS: f64 = 1e9;

/// The forces at the plates of a file, with y up.
#[derive(Debug, Clone, PartialEq)]
pub struct Forces {
    /// The time of each sample, seconds; frame 1 of the file is at 0.
    pub times: Vec<f64>,
    /// The plates in the file's order, in millimeters, y up.
    pub plates: Vec<Plate>,
}

/// What a plate's sample tells.
struct Sample {
    /// On the foot, N.
    force: DVec3,
    /// The center of pressure, cm; NaN where nothing stands on the plate.
    pressure: DVec3,
    /// About the middle of the surface, N m.
    moment: DVec3,
    /// The free moment about the center of pressure, N m; NaN where nothing stands on the plate.
    free: DVec3,
}

impl Forces {
    /// What the plates of a C3D file measured. `unit` and `up` go before what it says of its
    /// points; `up` tells left-handed axes, in which a plate's z points down whatever its corners
    /// say. No baseline is taken off.
    ///
    /// ```
    /// use posing_gait::Forces;
    /// use posing_io::C3d;
    ///
    /// let file = C3d::open("../../testdata/examples/gait/walk.c3d")?;
    /// let forces = Forces::from_c3d(&file, None, None)?;
    /// let up = forces.plates[0].force.iter().map(|f| f.y); // N
    /// assert!(up.fold(0.0, f64::max) > 500.0);
    /// assert!(forces.to_csv().starts_with(b"time,FP1.fx,FP1.fy,FP1.fz,FP1.px"));
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Data`]: the file has no force plates, one of another type than 1 to 4 or not whole,
    /// or does not say its unit, its axis that is up, or its rate; in left-handed axes a plate is
    /// upright, or its forces point into the floor.
    pub fn from_c3d(file: &C3d, unit: Option<LengthUnit>, up: Option<UpAxis>) -> Result<Forces> {
        let take = &file.take;
        let bad = |what: String| Error::data(Place::file(&take.name), what);
        let used = file.numbers("FORCE_PLATFORM:USED").first();
        let used = used.copied().unwrap_or(0.0) as usize;
        if used == 0 {
            return Err(bad("has no force plates".into()));
        }
        let units = take.units_or(unit, up)?;
        let found = Plate::of_file(file, units, UpAxis::Y);
        if found.len() < used {
            let what = "with type, corners, origin and channels";
            let count = found.len();
            return Err(bad(format!("has {used} force plates, but {count} {what}")));
        }
        let numbered = found.into_iter().zip(1..).map(|(plate, n)| {
            let place = Place::file(&take.name).part(format!("force plate {n}"));
            plate.map_err(|e| e.at(place))
        });
        let plates = numbered.collect::<Result<Vec<Plate>>>()?;
        let is_left = units.up != units.up.handed(false);
        let turned = |plate: &Plate| is_left && plate.presses_from_below(DVec3::Y);
        if let Some(i) = plates.iter().position(turned) {
            let what = "its forces point into the floor; in left-handed axes its z must point down";
            return Err(bad(format!("force plate {}: {what}", i + 1)));
        }
        let rate = take
            .rate
            .ok_or_else(|| bad("does not say its rate".into()))?;
        let per_frame = plates[0].per_frame;
        // Those of the frames are the times that tables have, to the last bit.
        let first = (f64::from(take.first_frame) - 1.0) * per_frame as f64;
        let time = |k: usize| (first + k as f64) / (rate * per_frame as f64);
        Ok(Forces {
            times: (0..plates[0].force.len()).map(time).collect(),
            plates,
        })
    }

    /// A table of CSV, a sample a row: `time`, then of each plate n FPn.fx .fy .fz, the force on
    /// the foot, N; FPn.px .py .pz, the center of pressure, cm; FPn.mx .my .mz, the moment about
    /// the middle of the plate's surface, and FPn.tx .ty .tz, the free moment, N m. Below 10 N
    /// along the vertical the cells of center and free moment are empty.
    pub fn to_csv(&self) -> Vec<u8> {
        let mut out = b"time".to_vec();
        for title in self.titles(["f", "p", "m", "t"], |n, what| format!("FP{n}.{what}")) {
            out.push(b',');
            out.extend(title.as_bytes());
        }
        for (k, time) in self.times.iter().enumerate() {
            out.push(b'\n');
            push_f64(&mut out, *time);
            for plate in &self.plates {
                let s = sample(plate, k);
                for vector in [s.force, s.pressure, s.moment, s.free] {
                    for value in vector.to_array() {
                        out.push(b',');
                        if value.is_finite() {
                            push_f64(&mut out, rounded(value));
                        }
                    }
                }
            }
        }
        out.push(b'\n');
        out
    }

    /// OpenSim's external loads (.mot), a sample a row: of each plate n ground_force_n_vx vy vz,
    /// N; ground_force_n_px py pz, m; ground_torque_n_x y z, the free moment, N m. Below 10 N along
    /// the vertical force and torque are 0 and the point is that of the sample before. `name` is
    /// the first line.
    pub fn to_mot(&self, name: &str) -> Vec<u8> {
        let titles = self.titles(["force v", "force p", "torque "], |n, what| {
            format!("ground_{}", what.replace(' ', &format!("_{n}_")))
        });
        let titles: Vec<&str> = titles.iter().map(String::as_str).collect();
        let mut points = vec![DVec3::ZERO; self.plates.len()];
        let rows = self.times.iter().enumerate().map(|(k, time)| {
            let mut row = vec![*time];
            for (plate, point) in self.plates.iter().zip(&mut points) {
                let s = sample(plate, k);
                let [force, torque] = if s.is_loaded() {
                    *point = s.pressure / 100.0;
                    [s.force, s.free]
                } else {
                    [DVec3::ZERO; 2]
                };
                let all = [force, *point, torque].map(|v| v.to_array().map(rounded));
                row.extend(all.as_flattened());
            }
            row
        });
        opensim::storage(name, true, &titles, rows)
    }

    /// Three titles for each vector of each plate, numbered from 1.
    fn titles<const N: usize>(
        &self,
        vectors: [&str; N],
        title: impl Fn(usize, &str) -> String,
    ) -> Vec<String> {
        let mut all = Vec::new();
        for n in 1..=self.plates.len() {
            for vector in vectors {
                all.extend(["x", "y", "z"].map(|axis| title(n, &format!("{vector}{axis}"))));
            }
        }
        all
    }
}

impl Sample {
    fn is_loaded(&self) -> bool {
        !self.pressure.is_nan()
    }
}

fn sample(plate: &Plate, k: usize) -> Sample {
    let force = plate.force[k];
    let (pressure, free) = (plate.pressure(k) / 10.0, plate.free_moment(k) / 1e3);
    let is_loaded = force.y.abs() >= LEAST && pressure.is_finite() && free.is_finite();
    let shown = |v: DVec3| if is_loaded { v } else { DVec3::NAN };
    Sample {
        force,
        pressure: shown(pressure),
        moment: plate.moment[k] / 1e3,
        free: shown(free),
    }
}

/// A value as it is written; a zero has no sign.
fn rounded(value: f64) -> f64 {
    (PARTS * value).round() / PARTS + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level plate with these forces along y, each at (20, 0, -30) mm from its middle.
    fn plate(loads: &[f64]) -> Plate {
        let force: Vec<DVec3> = loads.iter().map(|f| DVec3::new(1.0, *f, 0.0)).collect();
        let arm = DVec3::new(20.0, 0.0, -30.0);
        Plate {
            center: DVec3::new(100.0, 50.0, 0.0),
            normal: -DVec3::Y,
            per_frame: 1,
            moment: force.iter().map(|f| arm.cross(*f)).collect(),
            force,
        }
    }

    fn rows(loads: &[f64], mot: bool) -> Vec<String> {
        let forces = Forces {
            times: (0..loads.len()).map(|k| k as f64).collect(),
            plates: vec![plate(loads)],
        };
        let out = if mot {
            forces.to_mot("walk")
        } else {
            forces.to_csv()
        };
        let text = String::from_utf8(out).unwrap();
        text.lines().map(str::to_string).collect()
    }

    #[test]
    fn what_is_below_ten_newtons_has_no_center() {
        let found = rows(&[9.99, 10.0, 0.0, f64::NAN, f64::INFINITY], false);
        assert!(found[0].starts_with("time,FP1.fx,FP1.fy,FP1.fz,FP1.px"));
        assert!(found[0].ends_with(",FP1.mz,FP1.tx,FP1.ty,FP1.tz"));
        assert_eq!(found[1], "0,1,9.99,0,,,,0.2997,-0.03,0.1998,,,");
        assert_eq!(found[2], "1,1,10,0,12,5,-3,0.3,-0.03,0.2,0,0,0");
        assert_eq!(found[3], "2,1,0,0,,,,0,-0.03,0,,,");
        assert_eq!(found[4], "3,1,,0,,,,,-0.03,,,,");
        assert_eq!(found[5], "4,1,,0,,,,,-0.03,,,,");
        assert_eq!(rows(&[], false).len(), 1);
    }

    #[test]
    fn loads_for_opensim_are_finite() {
        let found = rows(&[0.0, 10.0, 9.0, f64::NAN, f64::INFINITY], true);
        assert_eq!(
            found[..6].join(" "),
            "walk version=1 nRows=5 nColumns=10 inDegrees=yes endheader"
        );
        let titles: Vec<&str> = found[6].split('\t').collect();
        assert_eq!(titles[..2], ["time", "ground_force_1_vx"]);
        assert_eq!(titles[6..8], ["ground_force_1_pz", "ground_torque_1_x"]);
        assert_eq!(found[7], "0\t0\t0\t0\t0\t0\t0\t0\t0\t0");
        assert_eq!(found[8], "1\t1\t10\t0\t0.12\t0.05\t-0.03\t0\t0\t0");
        for (row, time) in found[9..].iter().zip(2..) {
            assert_eq!(*row, format!("{time}\t0\t0\t0\t0.12\t0.05\t-0.03\t0\t0\t0"));
        }
    }
}
