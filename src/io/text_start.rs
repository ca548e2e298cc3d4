//! Tables of text of other programs, told by their first lines.

use super::point_titles::{MOST_ROWS, PointTitles};

/// The most lines of an OpenSim header.
pub const MOST_HEADER_LINES: usize = 1000;
/// The bytes in which the titles of a table must end.
const MOST_LINE_BYTES: usize = 1 << 18;

/// Which table of text it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextStart {
    /// OpenSim's .mot or .sto: a header that ends in `endheader`.
    OpenSim,
    /// Sections of Vicon Nexus.
    Nexus,
    /// Points, of three dimensions or two, whose columns are not named as those of a pose table.
    Points,
    /// Points as a pose table has them.
    PoseTable,
}

/// Which table a file is that begins with this text, whose last line may be cut.
pub fn of_lines(start: &[u8]) -> Option<TextStart> {
    let start = &start[..start.len().min(MOST_LINE_BYTES)];
    let text = String::from_utf8_lossy(start);
    let mut lines: Vec<&str> = text.split(['\n', '\r']).collect();
    // What stands behind the last line break is no whole line yet.
    lines.pop();
    let mut header = lines.iter().take(MOST_HEADER_LINES);
    if header.any(|line| line.trim().eq_ignore_ascii_case("endheader")) {
        return Some(TextStart::OpenSim);
    }
    lines.retain(|line| !line.trim_matches(BLANK).is_empty());
    let first = *lines.first()?;
    if is_pose_table(first) {
        return Some(TextStart::PoseTable);
    }
    if is_section(first)
        && lines
            .get(1)
            .is_some_and(|line| section_rate(line).is_some())
    {
        return Some(TextStart::Nexus);
    }
    lines.truncate(MOST_ROWS);
    PointTitles::read(&lines).map(|_| TextStart::Points)
}

/// What is wrong with a text that begins so, where its titles are longer than is read of them.
pub fn too_long(start: &[u8]) -> Option<String> {
    let start = start.get(..MOST_LINE_BYTES)?;
    let lines = start.iter().filter(|b| matches!(b, b'\n' | b'\r')).count();
    (lines < MOST_ROWS).then(|| {
        format!(
            "begins with lines that are longer than the {MOST_LINE_BYTES} bytes that are read of titles: split its columns"
        )
    })
}

/// What an empty row of a spreadsheet consists of.
pub const BLANK: [char; 5] = [',', ';', '\t', ' ', '"'];

/// Whether a line is the title of a section of Vicon Nexus.
pub fn is_section(line: &str) -> bool {
    let title = line.trim_matches(BLANK);
    SECTIONS.iter().any(|s| title.eq_ignore_ascii_case(s))
}

/// The titles of sections, of Nexus and of the programs before it.
const SECTIONS: [&str; 12] = [
    "Trajectories",
    "Devices",
    "Model Outputs",
    "Joints",
    "Segments",
    "Events",
    "Analog",
    "Analog EMG",
    "Force Plates",
    "Forces",
    "Objects",
    "Eye Trackers",
];

/// The rate of a section: the line below its title, such as `100` or `100,Hz`.
pub fn section_rate(line: &str) -> Option<f64> {
    let mut cells = line.split([',', ';', '\t']).map(|c| c.trim_matches(BLANK));
    let rate = cells.next()?.parse::<f64>().ok()?;
    let is_unit = |c: &str| c.is_empty() || c.eq_ignore_ascii_case("hz");
    (rate > 0.0 && rate.is_finite() && cells.all(is_unit)).then_some(rate)
}

/// Whether this is the header of a pose table: it has NAME.x and NAME.y.
fn is_pose_table(header: &str) -> bool {
    let cells = || header.split(',').map(|c| c.trim_matches(['"', ' ']));
    let axis = |axis: &str| cells().find_map(|c| c.strip_suffix(axis)).is_some();
    axis(".x") && axis(".y")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_told_by_whole_lines() {
        for (text, want) in [
            ("time,a.x,a.y,a.z\n", Some(TextStart::PoseTable)),
            ("a.x,a.y\n", Some(TextStart::PoseTable)),
            ("time,a.x,a.y,a.z", None),
            ("bodyparts,a,a\ncoords,x,y\n", Some(TextStart::Points)),
            ("fnum,a_x,a_y,a_z\n", Some(TextStart::Points)),
            ("t,a.X,a.Y,a.Z\r\n", Some(TextStart::Points)),
            (",a,a,a\n,x,y,z\n", Some(TextStart::Points)),
            ("\n\nTrajectories\n100\n", Some(TextStart::Nexus)),
            ("TRAJECTORIES\r\n120,Hz\r\n", Some(TextStart::Nexus)),
            ("Devices,,,\n1000,,,\n", Some(TextStart::Nexus)),
            ("Trajectories\nof the left hand\n", None),
            (
                "any name\nversion=1\n\nendheader\n",
                Some(TextStart::OpenSim),
            ),
            ("a\nb\nc\n", None),
            ("", None),
        ] {
            assert_eq!(of_lines(text.as_bytes()), want, "{text:?}");
        }
        let long = format!("{}\n0\n", "name_x,name_y,name_z,".repeat(20_000));
        assert_eq!(of_lines(long.as_bytes()), None);
        assert!(too_long(long.as_bytes()).is_some_and(|what| what.contains("longer than")));
        assert_eq!(too_long("a\n".repeat(200_000).as_bytes()), None);
        assert_eq!(too_long(b"a_x"), None);
    }
}
