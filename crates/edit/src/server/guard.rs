//! Which requests are let in: those of the program's own page, and of nobody else on this machine
//! or any website.

use super::handler::Refusal;
use crate::{Error, Result};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, Uri};
use rand::TryRngCore;
use rand::rngs::OsRng;
use std::io;

/// The header that carries the token. A page of another origin cannot send it without a preflight,
/// which is refused.
const TOKEN: HeaderName = HeaderName::from_static("x-posing-token");

/// The headers of every response besides the page's policy.
const HEADERS: [(HeaderName, &str); 6] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
];

/// Checks requests, and marks responses.
pub(crate) struct Guard {
    /// The values of Host that are this server: another name that leads here is an attack by DNS
    /// rebinding.
    hosts: Vec<String>,
    /// 128 random bits in hexadecimal.
    token: String,
    /// The Content-Security-Policy.
    policy: HeaderValue,
}

impl Guard {
    /// A guard with a new token.
    ///
    /// # Panics
    /// If the policy does not begin with `default-src 'none'` or cannot be a header.
    pub(crate) fn new(port: u16, policy: &str) -> Result<Guard> {
        assert!(policy.starts_with("default-src 'none'"), "{policy}");
        let mut bits = [0; 16];
        let filled = OsRng.try_fill_bytes(&mut bits);
        filled.map_err(|e| Error::io("random numbers", io::Error::other(e)))?;
        let names = ["127.0.0.1", "localhost"];
        let mut hosts: Vec<String> = names.iter().map(|n| format!("{n}:{port}")).collect();
        if port == 80 {
            hosts.extend(names.map(String::from));
        }
        Ok(Guard {
            hosts,
            token: bits.iter().map(|b| format!("{b:02x}")).collect(),
            policy: HeaderValue::from_str(policy).expect("a policy of one line"),
        })
    }

    /// The address of the page. The token is in the fragment, which a browser never sends.
    pub(crate) fn address(&self) -> String {
        format!("http://{}/#token={}", self.hosts[0], self.token)
    }

    /// Whether a request may go on.
    pub(crate) fn check(
        &self,
        method: &Method,
        uri: &Uri,
        headers: &HeaderMap,
    ) -> std::result::Result<(), Refusal> {
        let is_own = |host: &[u8]| self.hosts.iter().any(|own| own.as_bytes() == host);
        let mut hosts = headers.get_all(header::HOST).iter();
        let host = hosts.next().map(HeaderValue::as_bytes);
        if !host.is_some_and(is_own) || hosts.next().is_some() {
            let what = format!("this is http://{} and no other host", self.hosts[0]);
            return Err(Refusal::new(403, what));
        }
        let is_own_origin =
            |o: &HeaderValue| (o.as_bytes().strip_prefix(b"http://")).is_some_and(is_own);
        if !headers.get_all(header::ORIGIN).iter().all(is_own_origin) {
            return Err(Refusal::new(403, "pages of other origins are refused"));
        }
        let is_page = method == Method::GET && uri.path() == "/";
        let token = headers.get(TOKEN).map_or(&b""[..], HeaderValue::as_bytes);
        if !is_page && !are_same(token, self.token.as_bytes()) {
            let what = "the token is missing or of another run; open the address that the program \
                        has printed";
            return Err(Refusal::new(401, what));
        }
        if method == Method::POST && !is_json(headers) {
            return Err(Refusal::new(
                415,
                "the content type is not application/json",
            ));
        }
        Ok(())
    }

    /// Adds the headers that every response has.
    pub(crate) fn mark(&self, headers: &mut HeaderMap) {
        headers.insert(header::CONTENT_SECURITY_POLICY, self.policy.clone());
        headers.extend(HEADERS.map(|(name, value)| (name, HeaderValue::from_static(value))));
    }
}

/// Compares without an early exit, so that the time does not tell how much of a guess is right.
fn are_same(a: &[u8], b: &[u8]) -> bool {
    let differing = a.iter().zip(b).fold(0, |all, (a, b)| all | (a ^ b));
    a.len() == b.len() && std::hint::black_box(differing) == 0
}

/// Whether the content type is JSON, whatever its parameters.
fn is_json(headers: &HeaderMap) -> bool {
    let kind = headers.get(header::CONTENT_TYPE).map(HeaderValue::to_str);
    let kind = kind.and_then(|k| k.ok()).unwrap_or_default();
    let kind = kind.split(';').next().unwrap_or_default().trim();
    kind.eq_ignore_ascii_case("application/json")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_equal_tokens_are_the_same() {
        assert!(are_same(b"0123", b"0123"));
        for other in [&b""[..], b"012", b"01234", b"1123", b"0124"] {
            assert!(!are_same(other, b"0123"));
        }
    }

    #[test]
    fn a_browser_leaves_out_port_80() {
        let guard = Guard::new(80, "default-src 'none'").unwrap();
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, HeaderValue::from_static("localhost"));
        let page = |guard: &Guard| guard.check(&Method::GET, &Uri::from_static("/"), &headers);
        assert_eq!(page(&guard), Ok(()));
        assert!(page(&Guard::new(81, "default-src 'none'").unwrap()).is_err());
    }

    #[test]
    #[should_panic]
    fn a_policy_that_allows_by_default_is_a_bug() {
        let _ = Guard::new(0, "script-src 'self'");
    }
}
