//! Triangles of one shade as the outlines of the areas that they cover together.

use std::collections::HashMap;
use std::fmt::Write;

type At = [i32; 2];

/// The path (SVG) around triangles that all turn the same way: edges between two of them are not
/// drawn.
///
/// Each edge is directed. Two that run in opposite directions cancel out; what is left closes into
/// loops, which wind around each position as often as triangles cover it, in whatever order they
/// are linked.
pub(crate) fn path(triangles: &[[At; 3]]) -> String {
    let mut left: HashMap<(At, At), u32> = HashMap::new();
    let edges = triangles
        .iter()
        .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]);
    let mut order = Vec::new();
    for (from, to) in edges.filter(|(from, to)| from != to) {
        match left.get_mut(&(to, from)) {
            Some(count) if *count > 0 => *count -= 1,
            _ => {
                *left.entry((from, to)).or_default() += 1;
                order.push((from, to));
            }
        }
    }
    // In the order of the triangles, so that equal meshes give equal paths.
    let mut next: HashMap<At, Vec<At>> = HashMap::new();
    let mut starts = Vec::new();
    for edge in order {
        if let Some(count) = left.get_mut(&edge).filter(|count| **count > 0) {
            *count -= 1;
            next.entry(edge.0).or_default().push(edge.1);
            starts.push(edge.0);
        }
    }
    let (mut out, mut at) = (String::new(), [0, 0]);
    for start in starts {
        while let Some(lap) = closed(start, &mut next) {
            write_loop(&mut out, &mut at, &lap);
        }
    }
    out
}

/// Takes a loop from `start` back to it out of the edges.
fn closed(start: At, next: &mut HashMap<At, Vec<At>>) -> Option<Vec<At>> {
    let mut lap = vec![start];
    let mut at = next.get_mut(&start)?.pop()?;
    while at != start {
        lap.push(at);
        // As many edges leave each corner as come to it, so there is one.
        at = next.get_mut(&at)?.pop()?;
    }
    Some(lap)
}

/// Writes a loop, relative to the last corner; corners on a straight line are left out.
fn write_loop(out: &mut String, at: &mut At, lap: &[At]) {
    let n = lap.len();
    let is_corner = |i: usize| {
        let [a, b, c] = [lap[(i + n - 1) % n], lap[i], lap[(i + 1) % n]];
        let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - b[0], c[1] - b[1]]);
        let cross = i64::from(u[0]) * i64::from(v[1]) - i64::from(u[1]) * i64::from(v[0]);
        let along = i64::from(u[0]) * i64::from(v[0]) + i64::from(u[1]) * i64::from(v[1]);
        cross != 0 || along < 0
    };
    let corners: Vec<At> = (0..n).filter(|i| is_corner(*i)).map(|i| lap[i]).collect();
    let [first, rest @ ..] = corners.as_slice() else {
        return;
    };
    let mut step = |letter: &str, from: At, to: At| {
        let [x, y] = [to[0] - from[0], to[1] - from[1]];
        // A minus sign parts numbers as well as a space does. Writing to memory cannot fail.
        let space = |v: i32, first: bool| if v < 0 || first { "" } else { " " };
        let first = !letter.is_empty();
        let _ = write!(out, "{letter}{}{x}{}{y}", space(x, first), space(y, false));
    };
    step("m", *at, *first);
    let mut from = *first;
    for (i, to) in rest.iter().enumerate() {
        step(if i == 0 { "l" } else { "" }, from, *to);
        from = *to;
    }
    out.push('z');
    // `z` goes back to where the loop began.
    *at = *first;
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The loops of a path.
    pub(crate) fn loops(path: &str) -> Vec<Vec<At>> {
        let (mut all, mut at) = (Vec::new(), [0, 0]);
        for part in path.split('z').filter(|p| !p.is_empty()) {
            let part = part
                .strip_prefix('m')
                .unwrap()
                .replace('l', " ")
                .replace('-', " -");
            let numbers: Vec<i32> = part
                .split_whitespace()
                .map(|v| v.parse().unwrap())
                .collect();
            let mut lap: Vec<At> = Vec::new();
            for step in numbers.chunks(2) {
                let from = lap.last().unwrap_or(&at);
                lap.push([from[0] + step[0], from[1] + step[1]]);
            }
            at = lap[0];
            all.push(lap);
        }
        all
    }

    /// Twice the area inside loops, with the sign of their turn.
    fn area(loops: &[Vec<At>]) -> i64 {
        let one = |lap: &Vec<At>| {
            let next = lap.iter().cycle().skip(1);
            let cross = |(a, b): (&At, &At)| i64::from(a[0] * b[1] - a[1] * b[0]);
            lap.iter().zip(next).map(cross).sum::<i64>()
        };
        loops.iter().map(one).sum()
    }

    #[test]
    fn edges_between_triangles_vanish() {
        let square = [[[0, 0], [10, 0], [10, 10]], [[0, 0], [10, 10], [0, 10]]];
        let loops = loops(&path(&square));
        assert_eq!(loops.len(), 1);
        assert_eq!((loops[0].len(), area(&loops)), (4, 200));
        assert_eq!(path(&[]), "");
        assert_eq!(path(&[[[3, 4]; 3]]), "");
    }

    #[test]
    fn the_area_is_kept_whatever_the_shape() {
        // A grid with holes, corners that touch, a triangle twice, a part on its own.
        let mut triangles = vec![[[70, 70], [75, 70], [70, 75]]; 2];
        for i in 0..36 {
            let (x, y) = (i % 6 * 7, i / 6 * 7);
            if i % 5 != 3 {
                triangles.push([[x, y], [x + 7, y], [x + 7, y + 7]]);
            }
            if i % 7 != 2 {
                triangles.push([[x, y], [x + 7, y + 7], [x, y + 7]]);
            }
        }
        let whole: i64 = triangles.iter().map(|t| area(&[t.to_vec()])).sum();
        let outline = path(&triangles);
        assert_eq!(area(&loops(&outline)), whole);
        assert_eq!(outline, path(&triangles));
    }
}
