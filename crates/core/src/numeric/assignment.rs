//! The cheapest assignment of rows to columns: the Hungarian method by shortest augmenting paths
//! (Jonker and Volgenant 1987), O(rows² · columns).

/// The column of each of `rows` such that no two share one and the sum of `cost(row, column)` is
/// least; `None`: a row does better alone at the cost `alone`.
pub fn assign(
    rows: usize,
    columns: usize,
    alone: f64,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    // The last column is that of rows that stay alone, of whom it holds any number.
    let width = columns + 1;
    let costs: Vec<f64> = (0..rows)
        .flat_map(|row| {
            let cost = &cost;
            let own = (0..columns).map(move |column| cost(row, column).min(alone));
            own.chain(std::iter::once(alone))
        })
        .collect();
    // Potentials of rows and columns, and the row in each column.
    let (mut of_row, mut of_column) = (vec![0.0; rows], vec![0.0; width]);
    let mut holder: Vec<Option<usize>> = vec![None; width];
    for first in 0..rows {
        let mut shortest = vec![f64::INFINITY; width];
        let mut before: Vec<Option<usize>> = vec![None; width];
        let mut done: Vec<usize> = Vec::new();
        let mut open: Vec<usize> = (0..width).collect();
        let (mut row, mut column) = (first, None);
        let end = loop {
            let mut least = (f64::INFINITY, 0);
            let (own, offset) = (&costs[row * width..][..width], of_row[row]);
            for (n, &next) in open.iter().enumerate() {
                let length = own[next] - offset - of_column[next];
                if length < shortest[next] {
                    (shortest[next], before[next]) = (length, column);
                }
                if shortest[next] < least.0 {
                    least = (shortest[next], n);
                }
            }
            let (step, n) = least;
            of_row[first] += step;
            for &c in &done {
                of_column[c] -= step;
                if let Some(held) = holder[c] {
                    of_row[held] += step;
                }
            }
            open.iter().for_each(|c| shortest[*c] -= step);
            let next = open.swap_remove(n);
            done.push(next);
            match holder[next] {
                Some(held) => (row, column) = (held, Some(next)),
                None => break next,
            }
        };
        let mut column = end;
        while let Some(from) = before[column] {
            holder[column] = holder[from];
            column = from;
        }
        holder[column] = Some(first);
        holder[columns] = None;
    }
    let mut out = vec![None; rows];
    for (column, row) in holder.iter().enumerate().take(columns) {
        if let Some(row) = row.filter(|row| cost(*row, column) < alone) {
            out[row] = Some(column);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least sum over all assignments.
    fn least(rows: &[Vec<f64>], alone: f64, is_taken: &mut Vec<bool>) -> f64 {
        let Some((row, rest)) = rows.split_first() else {
            return 0.0;
        };
        let mut best = alone + least(rest, alone, is_taken);
        for column in 0..row.len() {
            if !is_taken[column] {
                is_taken[column] = true;
                best = best.min(row[column] + least(rest, alone, is_taken));
                is_taken[column] = false;
            }
        }
        best
    }

    #[test]
    fn no_assignment_is_cheaper() {
        for seed in 0..60 {
            let (rows, columns) = (1 + seed % 5, 1 + (seed / 5) % 6);
            let of = |r: usize, c: usize| {
                50.0 + 49.0 * ((7 * seed + 13 * r) as f64 * 1.3 + (c * (r + 2)) as f64 * 2.1).sin()
            };
            let costs: Vec<Vec<f64>> = (0..rows)
                .map(|r| (0..columns).map(|c| of(r, c)).collect())
                .collect();
            for alone in [20.0, 60.0, 1e3] {
                let found = assign(rows, columns, alone, |r, c| costs[r][c]);
                let mut taken: Vec<usize> = found.iter().flatten().copied().collect();
                taken.sort_unstable();
                taken.dedup();
                assert_eq!(taken.len(), found.iter().flatten().count());
                let each = found.iter().enumerate();
                let sum: f64 = each.map(|(r, c)| c.map_or(alone, |c| costs[r][c])).sum();
                let best = least(&costs, alone, &mut vec![false; columns]);
                assert!((sum - best).abs() < 1e-9, "{costs:?}: {sum} {best}");
            }
        }
    }
}
