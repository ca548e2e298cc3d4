//! A page of text, tables and pictures without a script, which needs no other file.

use super::html::{fill, policy_hash};

const TEMPLATE: &str = include_str!("plain_page.html");
/// The colors and the tables of all such pages.
pub const STYLE: &str = concat!(
    include_str!("player/player.css"),
    include_str!("plain_page.css")
);

/// What such a page says. All but the title is HTML.
pub struct PlainPage<'a> {
    /// The title.
    pub title: &'a str,
    /// Paragraphs below it.
    pub lead: Vec<String>,
    /// The sections.
    pub main: String,
    /// Rules of style beyond those of all such pages.
    pub style: &'a str,
    /// The command that made it.
    pub command: &'a str,
    /// Where its numbers are too; may be empty.
    pub data: &'a str,
}

impl PlainPage<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let lead: String = self.lead.iter().map(|p| format!("<p>{p}</p>\n")).collect();
        let style = format!("{STYLE}{}", self.style);
        let data = match self.data {
            "" => String::new(),
            data => format!(" {data}"),
        };
        let values = [
            ("title", self.title),
            ("lead", &lead),
            ("main", &self.main),
            ("style", &style),
            ("style-hash", &policy_hash(&style)),
            ("version", env!("CARGO_PKG_VERSION")),
            ("command", self.command),
            ("data", &data),
        ];
        fill(TEMPLATE, &values)
    }
}
