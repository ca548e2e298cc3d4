//! Tables of text of other programs, known by their first lines.

use super::long_titles::LongTitles;
use super::point_titles::{MOST_ROWS, PointTitles};

/// The most lines of an OpenSim header.
pub(crate) const MOST_HEADER_LINES: usize = 1000;
/// The bytes in which the titles of a table must end.
const MOST_LINE_BYTES: usize = 1 << 18;

/// Which table of text it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TextStart {
    /// OpenSim's .mot or .sto: a header that ends in `endheader`.
    OpenSim,
    /// Sections of Vicon Nexus.
    Nexus,
    /// A row for each point in each frame.
    Long,
    /// Points, of three dimensions or two, whose columns are not named as those of a pose table.
    Points,
    /// Points as a pose table has them.
    PoseTable,
}

/// Which table a file is that begins with this text, whose last line may be cut: what its first
/// whole lines tell, so that no later ones change it, nor bytes behind them that are no text.
pub(crate) fn of_lines(start: &[u8]) -> Option<TextStart> {
    let start = &start[..start.len().min(MOST_LINE_BYTES)];
    let breaks = (0..start.len()).filter(|&i| matches!(start[i], b'\n' | b'\r'));
    let (mut rows, mut from) = (Vec::new(), 0);
    for end in breaks.take(MOST_HEADER_LINES) {
        let bytes = &start[from..end];
        from = end + 1;
        if is_binary(bytes) {
            return None;
        }
        let line = String::from_utf8_lossy(bytes);
        if line.trim().eq_ignore_ascii_case("endheader") {
            return Some(TextStart::OpenSim);
        }
        if line.trim_matches(BLANK).is_empty() || rows.len() == MOST_ROWS {
            continue;
        }
        rows.push(line);
        let lines: Vec<&str> = rows.iter().map(|row| &**row).collect();
        if let Some(found) = of_rows(&lines) {
            return Some(found);
        }
    }
    None
}

/// Which table these first rows, none of them empty, are those of.
fn of_rows(rows: &[&str]) -> Option<TextStart> {
    let first = *rows.first()?;
    if is_pose_table(first) {
        return Some(TextStart::PoseTable);
    }
    if is_section(first) && rows.get(1).is_some_and(|row| section_rate(row).is_some()) {
        return Some(TextStart::Nexus);
    }
    if LongTitles::read(first).is_some() {
        return Some(TextStart::Long);
    }
    PointTitles::read(rows).map(|_| TextStart::Points)
}

/// What a table of text that begins so has with axes, where none of it is a position by its title.
pub(crate) fn no_positions(start: &[u8]) -> Option<String> {
    let start = &start[..start.len().min(MOST_LINE_BYTES)];
    let text = String::from_utf8_lossy(start);
    let lines = text.split(['\n', '\r']);
    let filled = lines.filter(|line| !line.trim_matches(BLANK).is_empty());
    let rows: Vec<&str> = filled.take(MOST_ROWS).collect();
    PointTitles::no_positions(&rows)
}

/// Whether a file that begins so is no text.
pub(crate) fn is_binary(start: &[u8]) -> bool {
    start.iter().any(|b| *b < 9)
}

/// What is wrong with a text that begins so, where its titles are longer than is read of them.
pub(crate) fn too_long(start: &[u8]) -> Option<String> {
    let start = start.get(..MOST_LINE_BYTES)?;
    let lines = start.iter().filter(|b| matches!(b, b'\n' | b'\r')).count();
    (lines < MOST_ROWS).then(|| {
        format!(
            "begins with lines that are longer than the {MOST_LINE_BYTES} bytes that are read of \
             titles: split its columns"
        )
    })
}

/// What an empty row of a spreadsheet consists of.
pub(crate) const BLANK: [char; 5] = [',', ';', '\t', ' ', '"'];

/// Whether a line is the title of a section of Vicon Nexus.
pub(crate) fn is_section(line: &str) -> bool {
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
pub(crate) fn section_rate(line: &str) -> Option<f64> {
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
            ("x,y,z,Marker,Frame\n", Some(TextStart::Long)),
            ("x,y,z,marker\n", None),
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
        // What comes later does not count.
        let found = of_lines(b",a,a,a\n,x,y,z\r1,2\x00,3\n");
        assert_eq!(found, Some(TextStart::Points));
        assert_eq!(of_lines(b",a,a,a\n,x,y\x00,z\n"), None);
        let long = format!("{}\n0\n", "name_x,name_y,name_z,".repeat(20_000));
        assert_eq!(of_lines(long.as_bytes()), None);
        assert!(too_long(long.as_bytes()).is_some_and(|what| what.contains("longer than")));
        assert_eq!(too_long("a\n".repeat(200_000).as_bytes()), None);
        assert_eq!(too_long(b"a_x"), None);
    }
}
