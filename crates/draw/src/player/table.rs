//! A small table of text as HTML.

use crate::html::escape;
use crate::scene::Table;

/// The table, a column of numbers set flush right.
pub(crate) fn html(table: &Table) -> String {
    let number =
        |text: &str| text.trim_end_matches(['%', ' ']).parse::<f64>().is_ok() || text == "–";
    // A column is set flush right if it holds numbers only.
    let is_flush = |c: usize| {
        let mut cells = table
            .rows
            .iter()
            .map(|row| &row[c])
            .filter(|cell| !cell.is_empty());
        cells.clone().count() > 0 && cells.all(|cell| number(cell))
    };
    let flush: Vec<bool> = (0..table.header.len()).map(is_flush).collect();
    let class = |c: usize| if flush[c] { " class=\"number\"" } else { "" };
    let mut out = String::from("<div class=\"scores\"><table>\n");
    if !table.caption.is_empty() {
        let caption = escape(&table.caption);
        out.push_str(&format!("<caption><span>{caption}</span></caption>\n"));
    }
    out.push_str("<thead><tr>");
    for (c, head) in table.header.iter().enumerate() {
        out.push_str(&format!(
            "<th scope=\"col\"{}>{}</th>",
            class(c),
            escape(head)
        ));
    }
    out.push_str("</tr></thead>\n<tbody>\n");
    for (r, row) in table.rows.iter().enumerate() {
        out.push_str("<tr>");
        for (c, cell) in row.iter().enumerate() {
            let cell = match table.links.get(r).filter(|_| c == 0) {
                Some(link) => format!("<a href=\"{}\">{}</a>", escape(link), escape(cell)),
                None => escape(cell),
            };
            out.push_str(&format!("<td{}>{cell}</td>", class(c)));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table></div>");
    out
}
