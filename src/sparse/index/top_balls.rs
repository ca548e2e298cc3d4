//! The best of many balls.

use super::ball_tree::{LEAF, Lanes};

/// The best ball in each lane.
pub struct Leaders {
    score: Lanes,
    ball: [u32; LEAF],
}

impl Leaders {
    pub const NONE: Leaders = Leaders {
        score: Lanes([-1.0; LEAF]),
        ball: [0; LEAF],
    };

    /// Adds the balls of group `i`.
    #[inline(always)]
    pub fn meet(&mut self, score: &Lanes, i: usize) {
        for lane in 0..LEAF {
            let is_better = score.0[lane] > self.score.0[lane];
            let ball = (i * LEAF + lane) as u32;
            self.score.0[lane] = if is_better {
                score.0[lane]
            } else {
                self.score.0[lane]
            };
            self.ball[lane] = if is_better { ball } else { self.ball[lane] };
        }
    }

    /// The best ball of each lane.
    pub fn balls(&self) -> [u32; LEAF] {
        self.ball
    }

    /// The best K of `all` balls, the best first.
    #[inline(always)]
    pub fn best<const K: usize>(mut self, all: usize) -> [Option<usize>; K] {
        let mut best = [None; K];
        for best in &mut best {
            let mut lane = 0;
            for other in 1..LEAF {
                if self.score.0[other] > self.score.0[lane] {
                    lane = other;
                }
            }
            let ball = self.ball[lane] as usize;
            *best = (self.score.0[lane] >= 0.0 && ball < all).then_some(ball);
            self.score.0[lane] = -1.0;
        }
        best
    }
}
