//! The page of `posing edit`: HTML, complete in itself; it talks to the program that served it and
//! to nothing else.

use crate::draw::player::parts::{self, PAPER, Part, parts};
use base64::prelude::{BASE64_STANDARD, Engine};
use sha2::{Digest, Sha256};
use std::sync::LazyLock;

const PAGE: &str = include_str!("page.html");
static STYLE: LazyLock<String> =
    LazyLock::new(|| [parts::STYLE, include_str!("page.css")].concat());
/// The scripts of this page alone.
const OWN: &str = concat!(
    include_str!("core.js"),
    include_str!("names.js"),
    include_str!("link.js"),
    include_str!("now.js"),
    include_str!("order.js"),
    include_str!("geometry.js"),
    include_str!("views.js"),
    include_str!("figure.js"),
    include_str!("gesture.js"),
    include_str!("pins.js"),
    include_str!("drag.js"),
    include_str!("others.js"),
    include_str!("panel.js"),
    include_str!("starts.js"),
    include_str!("photograph.js"),
    include_str!("picture.js"),
    include_str!("keys.js"),
    include_str!("strip.js"),
    include_str!("files.js"),
    include_str!("guide.js"),
    include_str!("keyboard.js"),
    include_str!("start.js"),
);
static SCRIPT: LazyLock<String> = LazyLock::new(|| {
    let (camera, edge) = (parts(&[Part::Camera]), Part::Edge.source());
    format!(
        "(() => {{{PAPER}\nfunction lookAt(scene, path) {{{camera}\
         return {{ camera, resetCamera, lens, projection, readColors, drawGrid, ink }};\n}}\n\
         {edge}{OWN}}})();\n"
    )
});

/// The page, the same bytes always.
pub fn page() -> String {
    PAGE.replace("{{style}}", &STYLE)
        .replace("{{script}}", &SCRIPT)
}

/// The content security policy to serve the page with: its own style and script, requests to its
/// own server, pictures that the person chose, and nothing else.
pub fn policy() -> String {
    let hash = |source: &str| BASE64_STANDARD.encode(Sha256::digest(source.as_bytes()));
    format!(
        "default-src 'none'; script-src 'sha256-{}'; style-src 'sha256-{}'; img-src blob: data:; \
         connect-src 'self'; \
         frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
        hash(&SCRIPT),
        hash(&STYLE),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_whole_small_and_loads_nothing() {
        let page = page();
        assert!(page.len() < 150_000, "{} bytes", page.len());
        for loading in [
            "http://",
            "https://",
            "src=\"",
            "url(",
            "@import",
            "XMLHttp",
            "import(",
            "eval(",
            "{{",
            " style=\"",
            " onclick",
        ] {
            assert!(!page.contains(loading), "{loading}");
        }
        assert_eq!(page.matches("<script").count(), 1);
        assert_eq!(page.matches("href=").count(), 1, "the empty icon");
        for source in [SCRIPT.as_str(), STYLE.as_str()] {
            assert!(page.contains(source));
            assert!(
                !source.to_lowercase().contains("</s"),
                "nothing in them ends them"
            );
        }
    }

    #[test]
    fn the_policy_knows_the_pages_own_sources() {
        let policy = policy();
        assert!(policy.starts_with("default-src 'none'; script-src 'sha256-"));
        assert_eq!(policy.matches("'sha256-").count(), 2);
        assert!(!policy.contains("unsafe"));
    }
}
