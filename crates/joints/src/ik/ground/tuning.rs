//! The constants of grounding. Lengths are for a leg of 80 cm and scale with it.

/// A point tells the floor while it is slower than this, cm/s: toes of runners hardly are. Feet of
/// who swings from a bar are for 0.05 s.
pub(super) const SPEED: f64 = 30.0;
/// Speeds are measured over so many seconds before and after a frame: noise of 2 mm at 120 frames a
/// second looks like 17 cm/s from frame to frame, and like 4 over this time.
pub(super) const WINDOW: f64 = 0.04;
/// And for as long as this, seconds.
pub(super) const LEAST: f64 = 0.06;
/// Heights of a stance are taken over pieces of so many seconds.
pub(super) const PIECE: f64 = 0.12;
/// A stance counts once, and once more for each further second.
pub(super) const COUNTS: f64 = 1.0;
/// Who stands has the hip over the ankle by this share of the leg: who swims, lies or stands on
/// the hands has not.
pub(super) const ABOVE: f64 = 0.25;
/// A take stands if both feet together do so for this time in all, seconds.
pub(super) const STANDS: f64 = 0.2;

/// Residuals count up to this many standard deviations.
pub(super) const TRUNCATED: f64 = 3.0;
/// The widths, cm, over which residuals count, from the first fit to the last.
pub(super) const WIDTHS: [f64; 6] = [64.0, 32.0, 16.0, 8.0, 4.0, 2.0];
/// Fits of each width.
pub(super) const FITS: usize = 6;
/// The standard deviation of a stance's height, cm: as found, between these.
pub(super) const NOISE: [f64; 2] = [0.1, 1.0];
/// What a slope and a piece of drift must take from the sum of squares, in variances of a stance:
/// more than 3 standard errors. On a straight way at one speed both say the same; then it is slope.
pub(super) const PENALTY: [f64; 2] = [12.0, 18.0];
/// The slope, as a ratio, and the drift, cm, that are expected where stances do not tell them.
pub(super) const EXPECTED: [f64; 2] = [0.1, 30.0];
/// Drift that is no line has a knot per so many seconds.
pub(super) const KNOT: f64 = 10.0;
/// A floor slopes by this at most, degrees: what is steeper are stairs or a ramp.
pub(super) const STEEPEST: f64 = 12.0;
/// A slope below this, degrees, is none.
pub(super) const LEVEL: f64 = 0.25;
/// And both slope and drift are none that change heights of stances by less than this, cm.
pub(super) const EFFECT: f64 = 0.5;
/// Parts of a take, of as many samples each, of which one after another is left out to find
/// standard errors.
pub(super) const PARTS: usize = 8;
/// Slope and drift are so many times as large as their standard errors at least.
pub(super) const SURE: f64 = 4.0;
/// A stance is on the floor if it is within this of it, cm.
pub(super) const ON_FLOOR: f64 = 2.0;
/// In this share of the time of stances a point is on a floor that is one.
pub(super) const MOST: f64 = 0.6;
/// And in less than this share one is lower.
pub(super) const LOWER: f64 = 0.1;

/// Ankles are so high over soles, cm, at least: lower ones stand on joints that have a sole below.
pub(super) const ANKLE: f64 = 8.0;
/// A foot is flat in this share of its stance.
pub(super) const FLAT: f64 = 0.25;
/// Soles thinner than this, cm, are none.
pub(super) const THIN: f64 = 2.0;
/// A floor is at 0 if it is found there to so many cm: where joints are on soles, where these are
/// guessed from the ankles.
pub(super) const AT_ZERO: [f64; 2] = [0.75, 3.5];
/// Markers and joints of points are at most so high above soles, cm.
pub(super) const MARKERS: f64 = 6.0;

/// A foot is in contact while it is slower than this, cm/s.
pub(super) const SLOW: f64 = 20.0;
/// And lower than this over where it stands, cm.
pub(super) const HEIGHT: f64 = 3.0;
/// Feet of a body stand alike to so many cm; what stands higher is held up.
pub(super) const ALIKE: f64 = 2.0;
/// In a contact a foot is slower than so many times its median speed there, or than so many cm/s:
/// where it is faster, it is set elsewhere.
pub(super) const STEP: [f64; 2] = [4.0, 6.0];
/// A contact is still in which the foot moves by less than this, cm.
pub(super) const STILL: f64 = 0.1;
/// And is not held in which it moves by more than this from its middle: it does not stand.
pub(super) const SHIFTED: f64 = 4.5;
/// Over this time, seconds, what holds a foot fades before and after a contact.
pub(super) const FADE: f64 = 0.2;
/// Hips are lowered by this at most, cm, for legs that are too short.
pub(super) const LOWERED: f64 = 3.0;
