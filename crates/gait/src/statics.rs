//! What a static trial tells: how a foot and the head lie when a person stands upright.

use crate::angles::{Body, Direction};
use crate::axes::{yxz, zy};
use crate::markers::Markers;
use crate::parameters::{GivenValues, Parameters, Source, Subject};
use crate::side::Side;
use crate::upper::raw_head;

/// Whether the soles lay flat on the floor in the static trial, so that heel and toe markers count
/// as equally high. Files do not say it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FlatFoot {
    /// As the offsets stored in the static trial's file say; flat where it has none.
    #[default]
    Auto,
    /// The feet lay flat.
    Yes,
    /// The markers are as they are.
    No,
}

/// The offsets of a static trial, radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StaticOffsets {
    /// Plantar flexion and rotation of the left and the right foot.
    pub feet: [[f64; 2]; 2],
    /// NaN without a head.
    pub head: f64,
}

/// The names of a foot's offsets, behind its side.
pub(crate) const OFFSETS: [&str; 2] = ["StaticPlantFlex", "StaticRotOff"];

impl StaticOffsets {
    /// The offsets of a static trial; `stored` are those of its file.
    pub(crate) fn measure(
        markers: &Markers,
        subject: &Subject,
        flat: FlatFoot,
        stored: &GivenValues,
    ) -> StaticOffsets {
        let of = |flat: bool| StaticOffsets::of(markers, subject, flat);
        let in_radians = |v: &f64| v.abs() <= 1.0;
        let apart = |offsets: &StaticOffsets| {
            let name = |side: Side, i: usize| format!("{}{}", side.letter(), OFFSETS[i]);
            let all = Side::BOTH
                .into_iter()
                .flat_map(|side| [(side, 0), (side, 1)]);
            all.filter_map(|(side, i)| {
                Some(
                    (offsets.feet[side as usize][i]
                        - stored.get(&name(side, i)).filter(in_radians)?)
                    .abs(),
                )
            })
            .fold(0.0, f64::max)
        };
        match flat {
            FlatFoot::Yes => of(true),
            FlatFoot::No => of(false),
            FlatFoot::Auto => {
                let [flat, uneven] = [true, false].map(of);
                if apart(&uneven) < apart(&flat) {
                    uneven
                } else {
                    flat
                }
            }
        }
    }

    fn of(markers: &Markers, subject: &Subject, flat: bool) -> StaticOffsets {
        let lab = Direction::of(markers).axes();
        let (mut feet, mut head) = ([[Mean::default(); 2]; 2], Mean::default());
        for t in 0..markers.frames() {
            let frame = markers.frame(t);
            let body = Body::new(&frame, subject);
            for side in Side::BOTH {
                let leg = &body.legs[side as usize];
                let [.., mut heel, toe] = frame.leg(side);
                if flat {
                    heel.z = toe.z;
                }
                let [b, a, _] = yxz(leg.raw_foot, zy(heel - toe, leg.shank.y_axis));
                feet[side as usize][0].add(-b);
                feet[side as usize][1].add(-side.sign() * a);
            }
            let upright: [f64; 3] = yxz(raw_head(&frame), lab);
            head.add(upright[0]);
        }
        StaticOffsets {
            feet: feet.map(|foot| foot.map(|mean| mean.degrees().to_radians())),
            head: head.degrees().to_radians(),
        }
    }

    /// Takes over the offsets that nothing else said.
    pub(crate) fn fill(&self, parameters: &mut Parameters) {
        let feet = Side::BOTH.into_iter().flat_map(|side| {
            let foot = self.feet[side as usize];
            [0, 1].map(|i| (format!("{}{}", side.letter(), OFFSETS[i]), foot[i]))
        });
        for (name, value) in feet.chain([("HeadOffset".to_string(), self.head)]) {
            let is_open = parameters
                .0
                .get(&name)
                .is_some_and(|p| p.source == Source::Default);
            if is_open && value.is_finite() {
                parameters.set(&name, value, Source::Static, None);
            }
        }
    }
}

/// The mean of what is a number.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        if value.is_finite() {
            (self.sum, self.count) = (self.sum + value, self.count + 1.0);
        }
    }

    fn degrees(self) -> f64 {
        self.sum / self.count
    }
}
