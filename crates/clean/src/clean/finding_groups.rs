//! Findings of a take that say the same of several points or frames, put together.

use super::places::PlaceToSee;
use super::record::Summary;

/// Words that say how often and for how long, in findings that are alike.
const COUNTS: [&str; 6] = ["a", "once", "time", "times", "frame", "frames"];

/// Findings that say the same.
pub(super) struct FindingGroup<'a> {
    /// What it is about: what stands before the colon.
    pub kind: &'a str,
    /// What the first of them says.
    pub line: &'a str,
    /// Where the first is.
    pub places: Vec<&'a PlaceToSee>,
    /// What the others are about, and where these are.
    pub others: Vec<(&'a str, Option<&'a PlaceToSee>)>,
}

/// The findings of a file in groups, each where its first one is.
pub(super) fn groups(summary: &Summary) -> Vec<FindingGroup<'_>> {
    let mut groups: Vec<(Vec<String>, FindingGroup<'_>)> = Vec::new();
    for (i, finding) in summary.findings.iter().enumerate() {
        let (kind, line) = finding.split_once(": ").unwrap_or(("", finding));
        let of = |place: &&PlaceToSee| place.finding == Some(i);
        let places: Vec<&PlaceToSee> = summary.places.iter().filter(of).collect();
        let shape = shape(finding, &places);
        match groups.iter_mut().find(|(known, _)| *known == shape) {
            Some((_, group)) => {
                let first = places.first().copied();
                group.others.push((subject(line, &places), first));
            }
            None => {
                let others = Vec::new();
                let group = FindingGroup {
                    kind,
                    line,
                    places,
                    others,
                };
                groups.push((shape, group));
            }
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}

/// Whether a word is a name or a number rather than a word of ours.
fn is_open(word: &str, places: &[&PlaceToSee]) -> bool {
    let bare = word.trim_matches([',', '.', ':', ';', '(', ')']);
    let is_point = places.iter().any(|p| p.point.as_deref() == Some(bare));
    let is_name = |c: char| c.is_ascii_digit() || c.is_uppercase() || c == '*' || c == '_';
    is_point || bare.contains(is_name)
}

/// The words of a finding without what changes from one to the next.
fn shape(finding: &str, places: &[&PlaceToSee]) -> Vec<String> {
    // Which limb it is stands before the last colon.
    let (kind, rest) = finding.split_once(": ").unwrap_or(("", finding));
    let last = rest.rsplit_once(": ").map_or(rest, |(_, last)| last);
    let mut out = vec![kind.to_string()];
    for word in last.split_whitespace() {
        let is_count = COUNTS.contains(&word.trim_end_matches(','));
        if !is_count && !is_open(word, places) {
            out.push(word.to_string());
        }
    }
    out
}

/// What a finding is about: the point where it is, else the names that it begins with, or the limb.
fn subject<'a>(line: &'a str, places: &[&'a PlaceToSee]) -> &'a str {
    if let Some(point) = places.first().and_then(|p| p.point.as_deref()) {
        return point;
    }
    if let Some((limb, _)) = line.rsplit_once(": ") {
        return limb;
    }
    let mut end = 0;
    for word in line.split_inclusive(' ') {
        let is_name = is_open(word.trim_end(), places);
        if !is_name && word != "and " {
            break;
        }
        end += word.len();
    }
    line[..end].trim_end().trim_end_matches(" and")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groups_of(findings: &[&str], places: Vec<PlaceToSee>) -> Vec<(String, Vec<String>)> {
        let summary = Summary {
            findings: findings.iter().map(|f| f.to_string()).collect(),
            places,
            ..Summary::default()
        };
        let one = |g: &FindingGroup<'_>| {
            let others = g.others.iter().map(|(what, _)| what.to_string());
            (format!("{}: {}", g.kind, g.line), others.collect())
        };
        groups(&summary).iter().map(one).collect()
    }

    #[test]
    fn what_says_the_same_is_one() {
        let place = |i, point: &str| PlaceToSee {
            finding: Some(i),
            ..PlaceToSee::of("jump", Some(&point.to_string()), [7, 8])
        };
        let found = groups_of(
            &[
                "jump: head jumps off its path 2 times, by 3.3 cm in frame 55 (limit 3 cm)",
                "labels: *3 in frames 2 to 9 may be LSHO: not sure, so it has no label",
                "jump: lwrist jumps off its path once, by 4.0 cm in frame 7 (limit 3 cm)",
                "skeleton: left leg: no marker from 0.10 to 0.90 s; its motion is a guess",
                "labels: *4 in frames 5 to 9 may be RSHO: not sure, so it has no label",
                "skeleton: right arm: no marker from 1.10 to 1.90 s; its motion is a guess",
                "drift: RANK and RKNE are 41.5 cm apart at first and 39.2 cm at last (limit 2 cm)",
                "drift: RFHD and LBWT are 68.9 cm apart at first and 71.4 cm at last (limit 2 cm)",
                "jump: LSHO stands off its place for 5 frames from frame 9 on, by 4.0 cm",
            ],
            vec![place(0, "head"), place(2, "lwrist")],
        );
        let others: Vec<Vec<&str>> = (found.iter())
            .map(|(_, others)| others.iter().map(String::as_str).collect())
            .collect();
        let none: Vec<&str> = Vec::new();
        assert_eq!(
            others,
            [
                vec!["lwrist"],
                vec!["*4 in frames 5 to 9 may be RSHO"],
                vec!["right arm"],
                vec!["RFHD and LBWT"],
                none
            ]
        );
        assert!(found[0].0.starts_with("jump: head jumps"));
    }

    #[test]
    fn what_says_something_else_stays_alone() {
        let found = groups_of(
            &[
                "labels: LSHO and LELB changed places in frames 1 to 3, or in all others",
                "labels: no label fits 3 tracks that are seen in most of the take (*1)",
                "unit: the body is 3 m tall",
                "rate: the body is 3 m tall",
            ],
            Vec::new(),
        );
        assert_eq!(found.len(), 4);
    }
}
