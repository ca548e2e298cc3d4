//! The constants of labels, by the file that they are used in.

/// Left and right exchanged. Prototype: takes of 02, 13, 35 and 49 degraded to keypoints of 30
/// frames a second with correlated noise of 1 to 3 cm, seeds 2 and 3: 1.000 of 4,576 exchanged
/// positions found, none of 49,139 others. Each pair by itself, seeds 2 to 4, without the speed
/// nearby: 98% of 6,054, 70 of 67,025 others. In every sixth of CMU's takes here, with gaps, clean
/// or with white noise of 1 and 2 cm, at 120 and 30 frames a second: none found.
pub(crate) mod exchanges {
    /// How fast the points of a body are, at least, cm/s: 8 cm in a frame at 30 frames a second.
    /// They may be as fast as they are nearby, so many seconds, and frames, before and after.
    pub(crate) const FAST: f64 = 240.0;
    pub(crate) const NEARBY: f64 = 0.25;
    pub(crate) const FEWEST_NEARBY: usize = 3;
    /// Cost of a way that no body goes.
    pub(crate) const FARTHEST: f64 = 25.0;
    /// Cost of an exchange that begins or ends, for its first pair and each further one.
    pub(crate) const CHANGE: f64 = 5.0;
    pub(crate) const FURTHER_CHANGE: f64 = 1.0;
    /// Cost of a frame in which a pair is exchanged: names are right mostly.
    pub(crate) const EXCHANGED: f64 = 0.15;
    /// Pairs, frame by frame, both points of which are seen while they are exchanged, at least.
    pub(crate) const FEWEST_SEEN: usize = 2;
    /// Pairs of a limb, at most: the states of a frame double with each.
    pub(crate) const MOST_PAIRS: usize = 5;
    /// Frames in which distances are measured, at most about.
    pub(crate) const SAMPLED: usize = 100;
}

/// How likely a distance is.
pub(crate) mod marker_distances {
    /// Frames that a distance is measured in, at most about.
    pub(crate) const MOST_FRAMES: usize = 1500;
    /// Frames in which one of all pairs is known, at least.
    pub(crate) const FEWEST_FRAMES: usize = 20;
    /// Least spread of a distance, cm: skin and cloth move.
    pub(crate) const LEAST_SPREAD: f64 = 0.4;
    /// Share of lengths that are those to any point, within so many cm.
    pub(crate) const ANY: f64 = 0.03;
    pub(crate) const ANYWHERE: f64 = 60.0;
    /// By how much of its length a distance is looser.
    pub(crate) const LOOSER: f64 = 0.004;
    /// Distances that spread by no more and are no longer are steady, cm; so many tell two people
    /// apart, at least.
    pub(crate) const RIGID: f64 = 0.8;
    pub(crate) const RIGID_NEAR: f64 = 40.0;
    /// Distances from so many cm on tell sizes; the length of a body by which sizes differ, cm.
    pub(crate) const RIGID_LONG: f64 = 12.0;
    pub(crate) const BODY: f64 = 50.0;
    pub(crate) const FEWEST_RIGID: usize = 12;
}

/// Stretches of a track away from its point.
pub(crate) mod out_and_back {
    /// Least jump, cm.
    pub(crate) const LEAST: f64 = 4.0;
    /// Least jump, in differences that few of the steps nearby exceed.
    pub(crate) const UNUSUAL: f64 = 3.0;
    /// Frames on either side of a step that are nearby, and the share of their steps that are
    /// usual.
    pub(crate) const NEARBY: usize = 6;
    pub(crate) const USUAL: f64 = 0.8;
    /// One in so many of the steps nearby may be half as large as both jumps, these aside.
    pub(crate) const JUMPY: usize = 8;
    /// Longest stretch, seconds.
    pub(crate) const LONGEST: f64 = 0.6;
    /// Other points, the nearest, that may be steady beside a point, and the steadiest that count.
    pub(crate) const OTHERS: usize = 60;
    pub(crate) const STEADIEST: usize = 3;
    /// Distances that spread by no more are rigid, cm.
    pub(crate) const RIGID: f64 = 1.0;
    /// Frames in which a distance is known, at least.
    pub(crate) const FEWEST_FRAMES: usize = 20;
    /// Nats by which the way across is likelier, at least: where a fifth of all positions are off,
    /// distances seem loose, and what lies between two of these would else be away now and then.
    pub(crate) const EVIDENCE: f64 = 6.0;
    /// Frames of a stretch whose distances are looked at, at most.
    pub(crate) const MOST_FRAMES: usize = 48;
}

/// People of a take. In 29 takes of one person, of 14 to 62 markers, no body is parted; two of them
/// that move apart always are, those that stand still never.
pub(crate) mod people {
    /// Points that names tell to be a person, at least.
    pub(crate) const FEWEST_NAMED: usize = 4;
    /// Names that two people share, at least, where no colon parts them.
    pub(crate) const FEWEST_SHARED: usize = 12;
    /// Names with a left and a right among those that two people share, at least.
    pub(crate) const FEWEST_SIDED: usize = 4;
    /// Points of a body that distances tell, at least; it has one in so many of all, and of more
    /// labels bodies are not asked for.
    pub(crate) const FEWEST_OF_BODY: usize = 8;
    pub(crate) const LARGEST_SHARE: usize = 4;
    pub(crate) const MOST_LABELS: usize = 250;
    /// Distances within a body are no longer, and spread less, cm.
    pub(crate) const NEAR: f64 = 70.0;
    pub(crate) const STEADY: f64 = 4.0;
}

/// Fragments of tracks. No cut of 235 swaps in 14 takes is missed, the prototype's measurement.
pub(crate) mod fragments {
    /// Least miss of both sides' fits, cm, and least step.
    pub(crate) const LEAST: f64 = 1.0;
    pub(crate) const LEAST_STEP: f64 = 0.6;
    /// Least miss, in those that are usual within so many seconds and in the run; these are so many
    /// cm at least.
    pub(crate) const UNUSUAL: f64 = 6.0;
    pub(crate) const NEARBY: f64 = 0.5;
    pub(crate) const LEAST_USUAL: f64 = 0.02;
    /// Least miss, in standard deviations about the fits.
    pub(crate) const RESIDUALS: f64 = 3.0;
    /// One of cuts within so many frames stays, that with the largest miss over this and the
    /// deviation, cm.
    pub(crate) const APART: usize = 3;
    pub(crate) const RESIDUAL_ADDED: f64 = 0.05;
    /// Near an end, the least step over [`LEAST`], in the largest other within so many frames.
    pub(crate) const END_STEP: f64 = 3.0;
    pub(crate) const END_STEPS: usize = 8;
}

/// Links between fragments. Across 730 of 730 jumps of swaps in 7 takes they are right, the
/// prototype's measurement.
pub(crate) mod links {
    /// Frames through which a line tells an end.
    pub(crate) const LINE: usize = 4;
    /// Longest gap, seconds.
    pub(crate) const LONGEST: f64 = 0.2;
    /// Standard deviations: of a position, cm, of an acceleration, cm/s², and of a velocity, cm a
    /// frame.
    pub(crate) const NOISE: f64 = 0.25;
    pub(crate) const ACCELERATION: f64 = 300.0;
    pub(crate) const VELOCITY_NOISE: f64 = 0.06;
    /// Speed of a point that hardly moves, cm/s.
    pub(crate) const STILL: f64 = 60.0;
    /// Highest cost of a link, and by how much it is cheaper than others, χ².
    pub(crate) const HIGHEST: f64 = 36.0;
    pub(crate) const CHEAPER: f64 = 12.0;
    /// The same of a link that closes a gap at both ends, and the longest time to each, seconds: a
    /// reflection is farther away.
    pub(crate) const CLOSED: f64 = 16.0;
    pub(crate) const CLOSED_GAP: f64 = 0.08;
}

/// What distances say of a position.
pub(crate) mod evidence {
    /// The most rigid neighbors that count, those kept in their stead where one is not seen, and
    /// how many are seen at least.
    pub(crate) const NEIGHBORS: usize = 10;
    pub(crate) const SPARE: usize = 4;
    pub(crate) const FEWEST_SEEN: usize = 3;
    /// Frames of a label's own positions that are looked at, at most, and the share that is few.
    pub(crate) const OWN_FRAMES: usize = 300;
    pub(crate) const FEW: f64 = 0.05;
    /// Seconds after which a frame says something new.
    pub(crate) const APART: f64 = 0.1;
}

/// Exchanges of labels.
pub(crate) mod identities {
    /// Labels of a ring, at most.
    pub(crate) const LONGEST_RING: usize = 6;
    /// Every so many seconds it is asked whether the distances say that labels changed places
    /// unseen, where an exchange has no other end.
    pub(crate) const EVERY: f64 = 0.25;
    /// How often distances are learned anew of what is known then.
    pub(crate) const ROUNDS: usize = 2;
    /// Frames that are looked at in an interval, at most.
    pub(crate) const MOST_FRAMES: usize = 48;
    /// Nats by which one way is clearly likelier than another.
    pub(crate) const CLEAR: f64 = 12.0;
    /// States that are followed, at most.
    pub(crate) const MOST_STATES: usize = 24;
}

/// The mirror image of a body. Swaps of 35 to 65% of a take, 40 on each of 8 takes: 263 decided
/// right, 57 not, none wrong, the prototype's measurement.
pub(crate) mod mirror {
    /// The most rigid neighbors of the image that count, and the most that their distances spread,
    /// cm: a head turns, so that those to the trunk say little.
    pub(crate) const NEIGHBORS: usize = 10;
    pub(crate) const LOOSEST: f64 = 2.5;
    /// How uneven the sides of a body are: standard deviations, cm, and share of the distance.
    pub(crate) const UNEVEN: f64 = 1.5;
    pub(crate) const UNEVEN_SHARE: f64 = 0.05;
    /// Highest cost of a distance.
    pub(crate) const HIGHEST: f64 = 9.0;
    /// Neighbors and unevenness where exchanges in every frame are looked for. Chosen on eight
    /// takes (85_02, 06_01, HDM dg, arnold 01, SprintCalib, Eb015pr, two static ones of Plug-in
    /// Gait), in which no pair gains over 10.6 then.
    pub(crate) const WHOLE_NEIGHBORS: usize = 6;
    pub(crate) const WHOLE_UNEVEN: f64 = 2.0;
}

/// Which way round two labels lie. In twenty takes of eight marker sets all pairs that most volumes
/// say are turned were exchanged: in the foot of a patient, a wrist of another, and by hand.
pub(crate) mod chirality {
    /// The most rigid neighbors that span volumes; their distances spread no more than this, cm,
    /// and this share of them. In a body that stands still they are no farther than so many times
    /// what the two labels are apart.
    pub(crate) const NEIGHBORS: usize = 8;
    pub(crate) const RIGID: f64 = 0.8;
    pub(crate) const RIGID_SHARE: f64 = 0.03;
    pub(crate) const STILL_NEAR: f64 = 2.5;
    /// Volumes that have one sign on each side, at least, and the share of them that agree.
    pub(crate) const FEWEST: i32 = 6;
    pub(crate) const MOST: f64 = 0.9;
    /// Frames that are looked at, at most, and at least.
    pub(crate) const MOST_FRAMES: usize = 30;
    pub(crate) const FEWEST_FRAMES: usize = 10;
    /// Share of the frames in which a volume has one sign.
    pub(crate) const ONE_SIGN: f64 = 0.95;
    /// Volumes that are smaller, in that of as long edges at right angles, are flat.
    pub(crate) const FLAT: f64 = 0.1;
}

/// Which side of an exchange is right.
pub(crate) mod sides {
    /// Share of the take on the shorter side of an exchange from which the mirror image is asked,
    /// and from which nothing else decides; how much cheaper it makes the right side.
    pub(crate) const LONG: f64 = 0.2;
    pub(crate) const OPEN: f64 = 1.0 / 3.0;
    pub(crate) const CLEAR: f64 = 12.0;
}

/// Labels put right.
pub(crate) mod repair {
    /// Where most fragments have fewer frames, labels are not checked.
    pub(crate) const FEWEST_FRAMES: usize = 5;
    /// Rounds over the paths, at most.
    pub(crate) const ROUNDS: usize = 3;
    /// Frames of a path that are looked at, at most; nats a frame, at most; and how many frames
    /// that say something new count at most.
    pub(crate) const MOST_FRAMES: usize = 48;
    pub(crate) const MOST_NATS: f64 = 20.0;
    pub(crate) const MOST_WEIGHT: f64 = 20.0;
    /// Nats a frame for a path's own name.
    pub(crate) const NAMED: f64 = 1.5;
    /// Nats for an end that goes on exactly, and against one that does not, at most.
    pub(crate) const LINKED: f64 = 6.0;
    pub(crate) const UNLINKED: f64 = 15.0;
    /// Least gain of a move.
    pub(crate) const LEAST_GAIN: f64 = 8.0;
    /// Nats for the ends from which a path goes on, and then by how much lower a frame may be.
    pub(crate) const GOES_ON: f64 = 5.0;
    pub(crate) const LOWER: f64 = 2.0;
    /// A path of so many seconds whose ends speak no more than so much against it, with so many
    /// nats a frame, so many more than for any other label, fits too.
    pub(crate) const LASTING: f64 = 0.2;
    pub(crate) const BROKEN: f64 = 6.0;
    pub(crate) const GOOD: f64 = 2.5;
    pub(crate) const BETTER: f64 = 5.0;
    /// So does one with so many nats in all.
    pub(crate) const SURE: f64 = 20.0;
    /// A path leaves its label below so many nats in all, where it jumps and where not.
    pub(crate) const POOR: f64 = -4.0;
    pub(crate) const POOREST: f64 = -25.0;
    /// Nats that speak for a path that jumps off its point and back ([`super::out_and_back`] says
    /// how far and how long).
    pub(crate) const AWAY_SCORE: f64 = 15.0;
    /// Every so many frames of a path it is asked who else is there.
    pub(crate) const FRAME_STEP: usize = 3;
}

/// Labels that are exchanged in every frame of a take. Prototype, neighbors 4 to 30 cm apart: by a
/// template of the person 99% found, by the mirror image 85 to 90%, no other.
pub(crate) mod whole_take {
    /// Least gain of an exchange, χ².
    pub(crate) const CLEAR: f64 = 12.0;
    /// Distances of pairs that may be exchanged, cm; the first for the mirror image.
    pub(crate) const NEAR: [f64; 2] = [4.0, 30.0];
    /// Labels of a person, at most: all pairs are compared.
    pub(crate) const MOST_LABELS: usize = 200;
}

/// Distances of a labeled take beside those of another. Chosen among some fifty variants on three
/// takes of three people by each other (06_01, 85_02, HDM dg; 126 exchanges): 120 found, 3 others
/// beside them, 2 in the takes as they are. On people that the choice did not see (three of Plug-in
/// Gait, four of clinics, beside each other and those) 158 of 173, 6 others beside them, none in
/// the takes as they are. Within a person (85_02, arnold, three others) all of 269, none beside.
pub(crate) mod person_template {
    /// Fewer labels say nothing of each other.
    pub(crate) const FEWEST_LABELS: usize = 4;
    /// How unlike the same distance is: standard deviations, cm, and share of it; in the same
    /// person and in another.
    pub(crate) const SAME_PERSON: [f64; 2] = [0.7, 0.02];
    pub(crate) const OTHER_PERSON: [f64; 2] = [3.0, 0.05];
    /// The most rigid neighbors of a label that count in another person.
    pub(crate) const MOST_RIGID: usize = 5;
    /// Distances whose spread is a smaller share of them tell the size of a body, so many of them.
    pub(crate) const STEADY: f64 = 0.08;
    pub(crate) const MOST_STEADY: usize = 200;
    /// Half of the distances of a body that stands still spread less, cm (.01 to .07 in eight
    /// static takes, 1.6 to 10 in fourteen others); one of two takes whose spreads are a smaller
    /// share of those of the other says nothing by them.
    pub(crate) const STANDING: f64 = 0.3;
    pub(crate) const STILLER: f64 = 0.1;
    /// By how many spreads of a body that moves a distance differs in one that stands. With one
    /// spread, a shoulder and an elbow seemed exchanged beside a static take with raised arms.
    pub(crate) const STANDS_OFF: f64 = 3.0;
    /// By which share of it a distance differs between two bodies that stand still.
    pub(crate) const POSTURE: f64 = 0.1;
    /// Highest cost of a distance.
    pub(crate) const HIGHEST: f64 = 9.0;
    /// The most rigid neighbors of a label that count beside one side of an exchange.
    pub(crate) const NEIGHBORS: usize = 10;
}

/// Left and right of a whole body. Prototype: 88 to 98% of volumes have their sign where names are
/// right, 4 to 11% where left and right are exchanged.
pub(crate) mod handedness {
    /// Quadruples of labels that are drawn, by which seed, and that must remain.
    pub(crate) const QUADRUPLES: usize = 2000;
    pub(crate) const SEED: u64 = 1;
    pub(crate) const FEWEST: usize = 20;
    /// Frames that are looked at, at most, and in which a quadruple is seen, at least.
    pub(crate) const MOST_FRAMES: usize = 200;
    pub(crate) const FEWEST_FRAMES: usize = 20;
    /// Share of the frames in which a volume has one sign, and share of the volumes of a take below
    /// which left and right are exchanged.
    pub(crate) const ONE_SIGN: f64 = 0.98;
    pub(crate) const LEAST: f64 = 0.5;
}

/// What the body says of labels. Exchanges of one pair in ten takes of eight people gained 37 to
/// 51 put back, and -14 to -58 made; where template and mirror are wrong the body loses 23 to 46.
pub(crate) mod body_evidence {
    /// Frames that it is fitted to, at most.
    pub(crate) const FRAMES: usize = 20;
    /// Labels of it that a person has, at least.
    pub(crate) const FEWEST_LABELS: usize = 12;
    /// Highest cost of a label, and the standard deviation about its place, cm.
    pub(crate) const HIGHEST: f64 = 25.0;
    pub(crate) const SD: f64 = 1.5;
    /// Costs from which on labels may be exchanged: of both, and of one; pairs that are looked at.
    pub(crate) const ODD: f64 = 6.25;
    pub(crate) const VERY_ODD: f64 = 16.0;
    pub(crate) const MOST_PAIRS: usize = 4;
    /// Gains of an exchange: what the body does not object to, what is told, what is sure beside
    /// something else that says so.
    pub(crate) const NO_OBJECTION: f64 = -5.0;
    pub(crate) const TOLD: f64 = 20.0;
    pub(crate) const SURE: f64 = 30.0;
}

/// People in tracks without names.
pub(crate) mod nameless {
    /// People of a take, at most.
    pub(crate) const MOST_PEOPLE: usize = 8;
    /// Tracks of so many seconds may be of another person, where as long one in so many of the
    /// labels is seen; every so many seconds they are looked at.
    pub(crate) const LONG: f64 = 0.5;
    pub(crate) const FEWEST_SHARE: usize = 3;
    pub(crate) const STEP: f64 = 0.1;
    /// Steady distances of one person differ by no more, cm, in the median, and sizes by 1%. In 36
    /// pairs of takes of one person they do by .04 to .29 (a child's in a turn by .60), in 670 of
    /// two people by .54 and more (two of Arnold's, who may be one, by .33).
    pub(crate) const SAME: f64 = 0.5;
    /// Nobody is seen between two people for so many seconds.
    pub(crate) const AWAY: f64 = 0.25;
}

/// Labels from nothing.
pub(crate) mod naming {
    /// Labels that the frames agree on, at least.
    pub(crate) const FEWEST_LABELS: usize = 8;
    /// Labels that they agree on, at least, as a share of those of the set or of the tracks that
    /// are seen at a time: .90 to 1.00 of the right set of nine takes, .03 to .76 of others.
    pub(crate) const LEAST_ELECTED: f64 = 0.75;
    /// Frames that are named by themselves, and how many of a stretch are looked at for the one.
    pub(crate) const KEY_FRAMES: usize = 18;
    pub(crate) const LOOKED_AT: usize = 24;
    /// Paths of so many seconds are named there.
    pub(crate) const SHORTEST: f64 = 0.15;
    /// How fast the vote of a frame falls with its cost over the least, in shares of that.
    pub(crate) const WEIGHT: f64 = 2.0;
    /// Share of the labels that are sure, at least, where no body tells which may be missing: in
    /// another posture than any of a template some plates fit others.
    pub(crate) const MOSTLY_SURE: f64 = 0.7;
    /// Rounds of a fit to the take: of a body, and of labels that grow from their neighbors.
    pub(crate) const ROUNDS: usize = 4;
    pub(crate) const GROWING_ROUNDS: usize = 8;
    /// Frames a second that it is fitted to, and frames of a path among them, at least.
    pub(crate) const RATE: f64 = 30.0;
    pub(crate) const FEWEST_PLACES: usize = 3;
    /// Farthest distance from a label, cm.
    pub(crate) const FARTHEST: f64 = 12.0;
    /// Mean squared distance from which on a path is not the label, cm²; every so many seconds all
    /// paths are compared.
    pub(crate) const REJECTED: f64 = 60.0;
    pub(crate) const EVERY: f64 = 0.1;
    /// Share of the labels that may be no track's, before the set may be another.
    pub(crate) const MISSING: f64 = 0.1;
    /// Labels without a track, and long tracks without a label, by which people may be mixed: none
    /// in 16 takes of two and three people named right, 9 and 9 of two who stand close.
    pub(crate) const MIXED: usize = 3;
    /// By how many variances of its position on the body a label reaches farther.
    pub(crate) const WIDER: f64 = 2.0;
    /// Nats a frame that a label must be worth over others, which no path has.
    pub(crate) const NEEDLESS: f64 = 2.0;
    /// Standard deviation of a label about its position, cm, and the nats of a path by which its
    /// odds are e times as good: frames are not independent.
    pub(crate) const SD: f64 = 1.5;
    pub(crate) const SLOPE: f64 = 8.0;
    /// Deviations from its usual position from which on a label may be another, and is none.
    pub(crate) const UNUSUAL: f64 = 2.5;
    pub(crate) const ODD: f64 = 5.0;
    /// A label is almost free where those that have it have one in so many frames of a path.
    pub(crate) const SHORT: usize = 4;
    /// Both sides of a gap of a track of so many seconds are one marker, if it gets there with so
    /// many cm/s.
    pub(crate) const ONE_TRACK: f64 = 0.5;
    pub(crate) const REACH: f64 = 400.0;
    /// A person is there where one in so many of the labels is seen.
    pub(crate) const PRESENT_SHARE: usize = 4;
    /// Share of the take from which on a path is long, and how many such paths are tried.
    pub(crate) const LONG: f64 = 0.1;
    pub(crate) const TRIED: usize = 2;
    /// Share of the take that a label has at least: the rest may be reflections.
    pub(crate) const RARE: f64 = 0.15;
}

/// Labels of labeled takes, without a body.
pub(crate) mod posture_model {
    /// Labels that are seen, at least, and the share of a take's frames in which they are.
    pub(crate) const FEWEST_LABELS: usize = 4;
    pub(crate) const RARE: f64 = 0.05;
    /// Frames of a take that are looked at, and the share of its labels that a posture has.
    pub(crate) const LOOKED_AT: usize = 200;
    pub(crate) const FULL: f64 = 0.9;
    /// Postures of all takes, and of each at least; those that differ by less are one, cm.
    pub(crate) const MOST_POSTURES: usize = 12;
    pub(crate) const FEWEST_POSTURES: usize = 3;
    pub(crate) const ALIKE: f64 = 2.0;
    /// People, at most, that are compared with each other.
    pub(crate) const MOST_PEOPLE: usize = 20;
    /// Half of the distances of labels that stand still spread less, cm.
    pub(crate) const STANDING: f64 = 0.3;
    /// How much a distance changes in a body that was seen only standing, and how much one end of
    /// it goes round the other: shares of it; cm of the most rigid; and what is known of two that
    /// are never seen together, cm.
    pub(crate) const BENDS: f64 = 0.06;
    pub(crate) const TURNS: f64 = 0.1;
    pub(crate) const STIFF: f64 = 0.1;
    pub(crate) const FAR_APART: f64 = 20.0;
}

/// The search for names of a frame.
pub(crate) mod posture_search {
    /// Turns about the vertical, and how many of these of all postures are tried.
    pub(crate) const YAWS: usize = 12;
    pub(crate) const STARTS: usize = 8;
    /// Farthest distance that counts for that choice, cm.
    pub(crate) const FARTHEST: f64 = 30.0;
    /// Rounds, and the gates of the first and the last, cm.
    pub(crate) const GATES: usize = 12;
    pub(crate) const WIDE: f64 = 50.0;
    pub(crate) const NARROW: f64 = 8.0;
    pub(crate) const LAST_ROUNDS: usize = 2;
    /// Share of the labels of the best frame that fit in one whose posture is known; the cost of
    /// another.
    pub(crate) const KNOWN_POSTURE: f64 = 0.75;
    pub(crate) const NOWHERE: f64 = 1e9;
    /// Gates from which on distances tell by how exact they are, and how exact that is, cm.
    pub(crate) const EXACT: f64 = 15.0;
    pub(crate) const SD: f64 = 0.5;
    /// Rounds after which half of the starts are left, and the first of a frame beside another.
    pub(crate) const HALVED: [usize; 2] = [2, 5];
    pub(crate) const FROM_BESIDE: usize = 4;
    /// By which share of the gate distances seem to change more, as all labels carry all at first.
    pub(crate) const STIFFER: f64 = 0.1;
    /// The size is asked in gates below, cm, of distances so long, cm, that change by a smaller
    /// share; so many tell it, and nobody is smaller or larger.
    pub(crate) const SIZED: f64 = 25.0;
    pub(crate) const LONG: f64 = 8.0;
    pub(crate) const STEADY: f64 = 0.08;
    pub(crate) const FEWEST_RATIOS: usize = 10;
    pub(crate) const SIZES: [f64; 2] = [0.75, 1.35];
}

/// The fit of the labels to a take.
pub(crate) mod posture_fit {
    /// Neighbors that carry a label, and those that say which posture is nearest.
    pub(crate) const NEIGHBORS: usize = 8;
    pub(crate) const COMPARED: usize = 5;
    /// A label is held where the third of its neighbors is not so much looser than it is at best;
    /// else it is carried on over so many frames of the fit at most.
    pub(crate) const LOOSER: f64 = 4.0;
    pub(crate) const NEARBY: usize = 90;
    /// Frames as which count what labeled takes say of how rigid a distance is.
    pub(crate) const LEARNED: f64 = 30.0;
    /// Deviation of the most rigid neighbors, cm.
    pub(crate) const STIFF: f64 = 0.3;
    /// Positions of a label that tell where it is on this person, at least, and as how many count
    /// the labeled takes.
    pub(crate) const FEWEST: usize = 3;
    pub(crate) const BELIEVED: f64 = 3.0;
    /// Deviation of that: in the half of the labels that differ most, and cm, at least; of a label
    /// that is not known.
    pub(crate) const UNLIKE: f64 = 1.5;
    pub(crate) const LEAST_UNLIKE: f64 = 0.7;
    pub(crate) const UNKNOWN: f64 = 2.0;
    /// Deviations from which on the person's own position is hardly believed.
    pub(crate) const ODD: f64 = 2.5;
    /// How far a label may be from its position, of that on a body: at least; cm that count as all.
    pub(crate) const LEAST_REACH: f64 = 0.35;
    pub(crate) const REACHES: f64 = 2.0;
    /// Half of the labels are so far from where the postures have them, cm: they are not these.
    pub(crate) const OTHER: f64 = 4.0;
    /// Deviations from which on a label is elsewhere, and the share of them that may be before they
    /// are others.
    pub(crate) const MISPLACED: f64 = 4.0;
    pub(crate) const MOST_MISPLACED: f64 = 0.25;
    /// The size, as in the search; frames that tell it, at most.
    pub(crate) const SIZED_FRAMES: usize = 40;
    pub(crate) const LONG: f64 = 8.0;
    pub(crate) const STEADY: f64 = 0.08;
    pub(crate) const FEWEST_RATIOS: usize = 10;
    pub(crate) const SIZES: [f64; 2] = [0.75, 1.35];
}
