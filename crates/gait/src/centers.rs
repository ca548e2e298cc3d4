//! The joint centers alone, by what is given of the subject.

use crate::angles::{Body, CENTERS, Direction};
use crate::curves::Curves;
use crate::deviations::deviations;
use crate::markers::{MARKERS, Markers};
use crate::parameters::{Given, GivenValues, Parameters, Source};
use crate::side::Side;
use ndarray::Array2;

/// Plug-in Gait's joint centers, by [`Curves`]' names: `LHJC`, `LKJC`, `LAJC`, `LSJC`, `LEJC`,
/// `LWJC` and those of the right side.
#[derive(Debug, Clone, PartialEq)]
pub struct JointCenters {
    /// Millimeters, z up; NaN in frames in which a marker is missing. A center that has no frame,
    /// or whose opposite has none, is not there.
    pub places: Curves,
    /// Their deviations along each axis, mm: 0 in frames whose markers have none.
    pub deviations: Curves,
    /// Whether nothing says how large the markers are.
    pub diameter_is_assumed: bool,
}

/// The parameters of a side without which there are no centers.
const NEEDED: [&str; 3] = ["LegLength", "KneeWidth", "AnkleWidth"];

impl JointCenters {
    /// The centers by values that are given, never by estimates of them, but for the distance of
    /// the front markers of the pelvis, which that of the markers is. `sd` is the deviation of each
    /// marker of [`MARKERS`] by frames, mm; `statics` are the markers of the person standing.
    ///
    /// # Errors
    /// What is missing: parameters, or markers of both legs.
    pub fn new(
        markers: &Markers,
        sd: Option<&Array2<f64>>,
        given: &GivenValues,
        statics: Option<&Markers>,
    ) -> std::result::Result<JointCenters, &'static str> {
        let own = |name: &&str| ["L", "R"].map(|side| given.get(&format!("{side}{name}")));
        if NEEDED.iter().flat_map(own).any(|value| value.is_none()) {
            return Err("LegLength, KneeWidth, AnkleWidth of both sides");
        }
        let none = GivenValues::default();
        let parameters = Parameters::find(Given {
            trial: given,
            options: &none,
            statics: None,
            markers: statics.unwrap_or(markers),
        });
        let subject = parameters.subject();
        let bodies: Vec<Body> = (0..markers.frames())
            .map(|t| Body::new(&markers.frame(t), &subject))
            .collect();
        let is_seen = |i: usize, side: Side| bodies.iter().any(|b| b.centers(side)[i].is_finite());
        let is_known = |i: &usize| Side::BOTH.into_iter().all(|side| is_seen(*i, side));
        if !(0..3).all(|i| is_known(&i)) {
            return Err("LASI, RASI, SACR (or LPSI, RPSI), THI, KNE, TIB, ANK of both sides");
        }
        let lab = Direction::of(markers).axes();
        let sd = sd.map(|sd| deviations(markers, sd.view(), &subject, lab));
        let (mut places, mut doubts) = (Curves::new(), Curves::new());
        for i in (0..CENTERS.len()).filter(is_known) {
            for side in Side::BOTH {
                let name = format!("{}{}", side.letter(), CENTERS[i]);
                let own = bodies.iter().map(|body| body.centers(side)[i]);
                places.insert(name.clone(), own.collect());
                if let Some(sd) = &sd {
                    let first = sd[side as usize].iter();
                    let own = first.map(|all| all[all.len() - CENTERS.len() + i]);
                    doubts.insert(name, own.collect());
                }
            }
        }
        let diameter = parameters.0.get("MarkerDiameter").map(|p| p.source);
        Ok(JointCenters {
            places,
            deviations: doubts,
            diameter_is_assumed: diameter == Some(Source::Default),
        })
    }

    /// Deviations of points by their names as those of [`MARKERS`], in the unit that they have;
    /// what is no number is 0.
    pub fn marker_deviations(points: &[String], sd: &Array2<f64>) -> Array2<f64> {
        let own = |name: &String| {
            name.rsplit(':')
                .next()
                .unwrap_or_default()
                .trim()
                .to_string()
        };
        let names: Vec<String> = points.iter().map(own).collect();
        let columns = MARKERS.map(|marker| names.iter().position(|name| name == marker));
        Array2::from_shape_fn((sd.nrows(), MARKERS.len()), |(t, m)| {
            let value = columns[m].map(|p| sd[[t, p]]);
            value.filter(|sd| sd.is_finite()).unwrap_or(0.0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::testdata;
    use glam::DVec3;

    #[test]
    fn centers_are_those_of_what_is_given() {
        let frame = testdata::standing();
        let hand = MARKERS.iter().position(|m| *m == "RWRB").unwrap();
        let tracks = |whole: bool| {
            let all = MARKERS.into_iter().zip(frame.0).enumerate();
            let all = all.filter(|(m, _)| whole || *m != hand);
            Markers::new(all.map(|(_, (name, p))| (name, vec![p; 4]))).unwrap()
        };
        let (markers, mut given) = (tracks(true), GivenValues::default());
        let none = JointCenters::new(&markers, None, &given, None);
        assert!(none.unwrap_err().starts_with("LegLength"));
        for name in PARAMETERS_OF_A_SIDE {
            ["L", "R"]
                .iter()
                .for_each(|side| given.set(&format!("{side}{name}"), 90.0));
        }
        let mut sd = Array2::zeros((4, MARKERS.len()));
        let knee = MARKERS.iter().position(|m| *m == "LKNE").unwrap();
        sd[[2, knee]] = 2.0;
        let found = JointCenters::new(&markers, Some(&sd), &given, None).unwrap();
        assert!(found.places.len() == 12 && found.diameter_is_assumed);
        assert!(found.places["LWJC"][0].is_finite());
        let doubt = |name: &str, t: usize| found.deviations[name][t];
        assert!(doubt("LKJC", 2).length() > 1.0 && doubt("LAJC", 2).length() > 0.0);
        assert_eq!([doubt("LKJC", 1), doubt("LHJC", 2)], [DVec3::ZERO; 2]);
        // A wrist alone on one side is none.
        let found = JointCenters::new(&tracks(false), None, &given, None).unwrap();
        assert_eq!(found.places.len(), 8);
        let points = ["x", "A:LKNE"].map(String::from);
        let sd = Array2::from_shape_vec((1, 2), vec![5.0, 3.0]).unwrap();
        let sd = JointCenters::marker_deviations(&points, &sd);
        assert_eq!((sd[[0, knee]], sd.sum()), (3.0, 3.0));
    }

    const PARAMETERS_OF_A_SIDE: [&str; 7] = [
        "LegLength",
        "KneeWidth",
        "AnkleWidth",
        "ShoulderOffset",
        "ElbowWidth",
        "WristWidth",
        "HandThickness",
    ];
}
