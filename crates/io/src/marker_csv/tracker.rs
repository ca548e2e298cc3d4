//! Vicon Tracker writes rigid bodies in a section Objects: `Object:Object` above RX, RY, RZ, for
//! quaternions RW too, and TX, TY, TZ, in any order. Positions are points; rotations are carried
//! along as they stand, as NAME.rx and so on, quaternions as NAME.qx.

use crate::point_titles::PointTitles;

/// The section of rigid bodies.
pub(super) const OBJECTS: &str = "Objects";

/// The row of axes with X, Y, Z for TX, TY, TZ, as markers have them.
pub(super) fn plain_axes(axes: &str) -> String {
    (axes.replace("TX", "X").replace("TY", "Y")).replace("TZ", "Z")
}

/// A note where the row of units says that rotations are not in degrees.
pub(super) fn unit_note(units: &str) -> Option<String> {
    let mut cells = units.split([',', ';', '\t']);
    let is_in_radians = cells.any(|cell| cell.trim_matches(['"', ' ']) == "rad");
    is_in_radians.then(|| "its rotations are in radians, and stay so".to_string())
}

/// The columns of the rotations of rigid bodies, with their names: those about x, y, z, or four of
/// a quaternion.
pub(super) fn rotations(titles: &PointTitles) -> impl Iterator<Item = (String, usize)> {
    let has = |end: &str| titles.others.iter().any(|(title, _)| title.ends_with(end));
    let kind = if has("_RW") { 'q' } else { 'r' };
    titles.others.iter().filter_map(move |(title, column)| {
        let (name, axis) = title.rsplit_once("_R")?;
        let is_axis = ["X", "Y", "Z", "W"].contains(&axis);
        let axis = axis.to_ascii_lowercase();
        is_axis.then(|| (format!("{}.{kind}{axis}", name_of_object(name)), *column))
    })
}

/// The name of a rigid body: `Global Angle (Quaternion) Wand:Wand` is Wand.
pub(super) fn name_of_object(title: &str) -> &str {
    let name = title
        .strip_prefix("Global Angle")
        .and_then(|t| t.split_once(") "));
    let name = name.map_or(title, |(_, name)| name);
    match name.split_once(':') {
        Some((object, segment)) if object == segment => object,
        _ => name,
    }
}
