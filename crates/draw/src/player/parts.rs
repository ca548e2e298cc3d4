//! The parts of the scripts of pages with figures. A page names the parts that it uses; what these
//! use comes with them.

/// A part: the body of a function that has a `scene`, or some of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Frames and their times, the way of the figure.
    Time,
    /// The camera, colors, the ground.
    Camera,
    /// The clock, the slider, the buttons.
    Playback,
    /// Mouse, touch, keys, and links into the page.
    Gestures,
    /// Bones that cross.
    Edge,
    /// How points were filled, and where the gaps are.
    Fills,
    /// The drawing of poses.
    View,
    /// Curves of a joint.
    Curves,
    /// Lists of rows to click, and that of the gaps.
    Gaps,
    /// The differences of two takes.
    Pair,
    /// Panels of poses, what is under the mouse, trails.
    Controls,
}

use Part::*;

impl Part {
    /// The parts, in the order in which they stand in a script.
    const ALL: [Part; 11] = [
        Time, Camera, Playback, Gestures, Edge, Fills, View, Curves, Gaps, Pair, Controls,
    ];

    /// The part without what it uses.
    pub fn source(self) -> &'static str {
        match self {
            Time => include_str!("time.js"),
            Camera => include_str!("camera.js"),
            Playback => include_str!("playback.js"),
            Gestures => include_str!("gestures.js"),
            Edge => include_str!("edge.js"),
            Fills => include_str!("fills.js"),
            View => include_str!("view.js"),
            Curves => include_str!("curves.js"),
            Gaps => include_str!("gaps.js"),
            Pair => include_str!("pair.js"),
            Controls => include_str!("controls.js"),
        }
    }

    /// The parts whose names this one uses.
    fn uses(self) -> &'static [Part] {
        match self {
            Time | Camera => &[],
            Playback => &[Time, Camera, Gestures],
            Gestures => &[Camera, Playback],
            Edge => &[Camera],
            Fills => &[Time, View],
            View => &[Time, Camera, Edge, Fills],
            Curves | Gaps | Pair => &[Controls],
            Controls => &[Playback, View, Curves, Gaps, Pair],
        }
    }
}

/// The sources of these parts and of all that they use, each once.
pub fn parts(wanted: &[Part]) -> String {
    let mut open = wanted.to_vec();
    let mut all = Vec::new();
    while let Some(part) = open.pop() {
        if !all.contains(&part) {
            all.push(part);
            open.extend(part.uses());
        }
    }
    let used = Part::ALL.iter().filter(|part| all.contains(part));
    used.map(|part| part.source()).collect()
}

/// What figures are drawn on: outside of all functions, before them.
pub const PAPER: &str = include_str!("paper.js");

/// The style of figures, and that of the page around them.
pub const STYLE: &str = include_str!("player.css");
/// See [`STYLE`].
pub const PAGE_STYLE: &str = include_str!("page.css");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_part_uses_comes_with_it_once_and_in_order() {
        assert_eq!(
            parts(&[Camera, Edge]),
            Camera.source().to_string() + Edge.source()
        );
        let view = [Time, Camera, Edge, Fills, View].map(Part::source);
        assert_eq!(parts(&[View]), view.concat());
        assert_eq!(parts(&[Controls]), Part::ALL.map(Part::source).concat());
    }
}
