//! A BVH file's words, and numbers among them.

use crate::io::text::{excerpt, parse_number};

/// Numbers beyond this are no lengths and no angles.
const LARGEST_NUMBER: f64 = 1e9;

/// Where in the text, and what is wrong there.
pub struct BvhFault(pub usize, pub String);

/// The text's words, separated by white space.
pub struct Tokens<'a> {
    /// The whole text.
    pub text: &'a str,
    /// How far it is read, in bytes.
    pub at: usize,
}

impl<'a> Tokens<'a> {
    /// The next word and where it starts.
    pub fn next(&mut self) -> Option<(usize, &'a str)> {
        let rest = &self.text[self.at..];
        let start = self.at + rest.find(|c: char| !c.is_ascii_whitespace())?;
        let rest = &self.text[start..];
        let end = rest
            .find(|c: char| c.is_ascii_whitespace())
            .unwrap_or(rest.len());
        // A brace is a word of its own even where no space follows.
        let end = if rest.starts_with(['{', '}']) { 1 } else { end };
        self.at = start + end;
        Some((start, &rest[..end]))
    }

    /// The next word, left where it is.
    pub fn peek(&mut self) -> Option<(usize, &'a str)> {
        let at = self.at;
        let word = self.next();
        self.at = at;
        word
    }

    /// What is left of the line, up to a brace: a name may have spaces.
    pub fn rest_of_line(&mut self) -> &'a str {
        let rest = &self.text[self.at..];
        let end = rest.find(['\n', '\r', '{', '}']).unwrap_or(rest.len());
        self.at += end;
        rest[..end].trim()
    }

    /// The line of a place, counted from 1.
    pub fn line_of(&self, at: usize) -> u64 {
        let before = &self.text.as_bytes()[..at.min(self.text.len())];
        1 + before.iter().filter(|&&b| b == b'\n').count() as u64
    }

    /// Three numbers, or the one asked for.
    pub fn numbers<const N: usize>(&mut self) -> std::result::Result<[f64; N], BvhFault> {
        let mut out = [0.0; N];
        for v in &mut out {
            let (at, word) = self.next().ok_or_else(|| {
                BvhFault(
                    self.text.len(),
                    "expected a number; the file is cut off".into(),
                )
            })?;
            *v = bounded(word).map_err(|what| BvhFault(at, what))?;
        }
        Ok(out)
    }
}

/// A finite number of a size that a body can have.
pub fn bounded(word: &str) -> std::result::Result<f64, String> {
    match parse_number(word)? {
        v if v.abs() <= LARGEST_NUMBER => Ok(v),
        _ => Err(format!(
            "\"{}\" is no length or angle of a body",
            excerpt(word)
        )),
    }
}
