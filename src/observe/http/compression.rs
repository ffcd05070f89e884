//! Compression of the web page: gzip, if the client accepts it.
//!
//! Files that are part of the program are compressed once, at their first request. The page itself is compressed for
//! each request. The compression runs on a separate thread, so that no bus line waits.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::{Mutex, PoisonError};

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use flate2::Compression;
use flate2::write::GzEncoder;

/// Content type of the web page.
const HTML: &str = "text/html; charset=utf-8";

/// Files that are already compressed. The key is the name of the file.
static FILES: Mutex<BTreeMap<&'static str, Bytes>> = Mutex::new(BTreeMap::new());

/// Returns an HTML page as an answer, compressed if the client accepts it.
pub(super) async fn page(headers: &HeaderMap, html: String) -> Response {
    let packed = match accepts_gzip(headers) {
        true => {
            let text = html.clone();
            off_the_lines(move || packed(text.as_bytes())).await
        }
        false => None,
    };
    answer(HTML, html.into(), packed)
}

/// Returns a file as an answer, compressed if the client accepts it. The text of the file must always be the same.
pub(super) async fn file(
    headers: &HeaderMap,
    name: &'static str,
    kind: &'static str,
    text: &'static str,
) -> Response {
    let packed = match accepts_gzip(headers) {
        true => match known(name) {
            Some(packed) => Some(packed),
            None => off_the_lines(move || keep(name, packed(text.as_bytes()))).await,
        },
        false => None,
    };
    answer(kind, Bytes::from_static(text.as_bytes()), packed)
}

/// Runs a computation on a separate thread, so that no bus line waits. Returns `None` if the computation returns `None`
/// or fails.
async fn off_the_lines(make: impl FnOnce() -> Option<Bytes> + Send + 'static) -> Option<Bytes> {
    tokio::task::spawn_blocking(make).await.ok().flatten()
}

fn known(name: &str) -> Option<Bytes> {
    FILES.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned()
}

fn keep(name: &'static str, packed: Option<Bytes>) -> Option<Bytes> {
    let packed = packed?;
    FILES.lock().unwrap_or_else(PoisonError::into_inner).insert(name, packed.clone());
    Some(packed)
}

/// Returns the text compressed with gzip; `None` if the compression fails.
fn packed(text: &[u8]) -> Option<Bytes> {
    let mut encoder = GzEncoder::new(Vec::with_capacity(text.len() / 3), Compression::default());
    // Writing to memory does not fail.
    encoder.write_all(text).ok()?;
    Some(encoder.finish().ok()?.into())
}

/// Makes the answer from the compressed text `packed`. If `packed` is `None`, makes the answer from the plain
/// text.
fn answer(kind: &'static str, text: Bytes, packed: Option<Bytes>) -> Response {
    let encoding: Option<(HeaderName, HeaderValue)> =
        packed.as_ref().map(|_| (header::CONTENT_ENCODING, HeaderValue::from_static("gzip")));
    let mut response = (
        [(header::CONTENT_TYPE, kind), (header::VARY, "Accept-Encoding")],
        Body::from(packed.unwrap_or(text)),
    )
        .into_response();
    response.headers_mut().extend(encoding);
    response
}

fn accepts_gzip(headers: &HeaderMap) -> bool {
    let given = headers.get_all(header::ACCEPT_ENCODING).into_iter().filter_map(|line| line.to_str().ok());
    names_gzip(given.flat_map(|line| line.split(',')))
}

/// Returns whether the encodings that a client accepts include gzip. The weight of `gzip` has precedence over the
/// weight of `*`.
fn names_gzip<'a>(encodings: impl Iterator<Item = &'a str>) -> bool {
    let (mut gzip, mut any) = (None, None);
    for one in encodings {
        let (name, weight) = one.split_once(';').unwrap_or((one, "q=1"));
        let weight = weight.trim().to_ascii_lowercase();
        let is_wanted = weight.strip_prefix("q=").and_then(|weight| weight.parse().ok()).unwrap_or(0.0) > 0.0;
        match name.trim().to_ascii_lowercase().as_str() {
            "gzip" | "x-gzip" => gzip = Some(is_wanted),
            "*" => any = Some(is_wanted),
            _ => {}
        }
    }
    gzip.or(any).unwrap_or(false)
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::GzDecoder;

    use super::*;

    #[test]
    fn gzip_is_used_if_the_client_accepts_it() {
        for (given, expected) in [
            ("gzip, deflate, br, zstd", true),
            ("br;q=1.0, gzip;q=0.8, *;q=0.1", true),
            ("GZIP", true),
            ("x-gzip", true),
            ("*", true),
            ("", false),
            ("identity", false),
            ("deflate, br", false),
            ("gzip;q=0", false),
            ("gzip;q=0, *", false),
            ("*;q=0", false),
            ("gzip;q=0.000", false),
            ("gzip;q=x", false),
            ("gzipped", false),
        ] {
            assert_eq!(names_gzip(given.split(',')), expected, "{given}");
        }
    }

    #[tokio::test]
    async fn a_compressed_answer_has_the_text_of_the_plain_one() {
        let text = "a page ".repeat(500);
        let mut headers = HeaderMap::new();
        let plain = page(&headers, text.clone()).await;
        assert_eq!(plain.headers().get(header::CONTENT_ENCODING), None);
        headers.insert(header::ACCEPT_ENCODING, HeaderValue::from_static("gzip"));
        let packed = page(&headers, text.clone()).await;
        assert_eq!(packed.headers()[header::CONTENT_ENCODING], "gzip");
        for answer in [&plain, &packed] {
            assert_eq!(answer.headers()[header::CONTENT_TYPE], HTML);
            assert_eq!(answer.headers()[header::VARY], "Accept-Encoding");
        }
        let body = axum::body::to_bytes(packed.into_body(), 10_000).await.unwrap();
        assert!(body.len() < text.len() / 10, "{}", body.len());
        let mut read = String::new();
        GzDecoder::new(&*body).read_to_string(&mut read).unwrap();
        assert_eq!(read, text);
    }

    #[tokio::test]
    async fn a_file_is_compressed_once() {
        let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static("gzip"))]);
        assert_eq!(known("a test's file"), None);
        let first = file(&headers, "a test's file", "text/css", "body { color: red }").await;
        let kept = known("a test's file").unwrap();
        let second = file(&headers, "a test's file", "text/css", "body { color: red }").await;
        for answer in [first, second] {
            assert_eq!(axum::body::to_bytes(answer.into_body(), 10_000).await.unwrap(), kept);
        }
    }
}
