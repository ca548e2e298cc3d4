//! Numbers of a text written anew beside those that stay, with as many digits as they have.

/// Digits after the point where a text has no numbers with some, and at least.
const DECIMALS: usize = 6;
const LEAST_DECIMALS: usize = 2;
/// And at most: more say nothing.
const MOST_DECIMALS: usize = 12;

/// How many digits after the point the numbers of a text have.
#[derive(Default)]
pub(super) struct Decimals {
    counts: [usize; MOST_DECIMALS + 1],
}

impl Decimals {
    /// Those of a number's text; `None` of one with an exponent or of no number.
    fn of(word: &[u8]) -> Option<usize> {
        let is_plain = word
            .iter()
            .all(|b| b.is_ascii_digit() || b"+-.".contains(b));
        let point = word.iter().position(|b| *b == b'.');
        let count = point.map_or(0, |at| word.len() - at - 1);
        (is_plain && !word.is_empty()).then_some(count.min(MOST_DECIMALS))
    }

    /// Counts a number that stays or goes.
    pub(super) fn count(&mut self, word: &[u8]) {
        if let Some(count) = Decimals::of(word) {
            self.counts[count] += 1;
        }
    }

    /// A value as a number, with the digits of the `word` that it replaces, or those that most
    /// have; the word itself where it says the same.
    pub(super) fn text(&self, value: f64, word: &[u8]) -> String {
        // Whole numbers only where there are no others.
        let usual = match self.counts.iter().position(|c| *c > 0) {
            None => DECIMALS,
            Some(first) => (1..=MOST_DECIMALS)
                .max_by_key(|d| self.counts[*d])
                .filter(|d| self.counts[*d] > 0)
                .unwrap_or(first),
        };
        let decimals = usual
            .max(Decimals::of(word).unwrap_or(0))
            .max(LEAST_DECIMALS);
        let text = format!("{value:.decimals$}");
        let number = |text: &str| text.parse::<f64>().ok();
        let word = std::str::from_utf8(word).unwrap_or_default();
        match number(&text) {
            Some(v) if number(word) == Some(v) => word.to_string(),
            Some(0.0) => text.trim_start_matches('-').to_string(),
            _ => text,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_of_their_neighbors() {
        let mut decimals = Decimals::default();
        assert_eq!(decimals.text(1.5, b"nan"), "1.500000");
        for word in ["0", "0", "0", "1.2500", "-3.1250", "1e-9", "nan", "2.25"] {
            decimals.count(word.as_bytes());
        }
        assert_eq!(decimals.text(-1.5, b"nan"), "-1.5000");
        assert_eq!(decimals.text(-1.5, b"0.123456"), "-1.500000");
        assert_eq!(decimals.text(-1e-9, b"1.25"), "0.0000");
        for same in ["1e0", "+1", "1.0", "-0.00"] {
            let value = same.parse::<f64>().unwrap() - 1e-9;
            assert_eq!(decimals.text(value, same.as_bytes()), same);
        }
        let mut whole = Decimals::default();
        whole.count(b"12");
        assert_eq!(whole.text(7.0, b"12"), "7.00");
    }
}
