//! Reader of a server's answer. The status line and the headers of HTTP/1.1 show whether the server has accepted the
//! message.

use std::time::Duration;

use httparse::{EMPTY_HEADER, Header, ParserConfig, Response, Status};
use tokio::io::{AsyncRead, AsyncReadExt};

use super::post::Failure;
use isotherm_profile::Url;

/// Maximum number of bytes of an answer that are read.
const LONGEST: usize = 16 * 1024;
/// Maximum number of headers of an answer.
const MOST_HEADERS: usize = 64;
/// Maximum pause that a server may request. A longer pause is shortened to this value.
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// Reads an answer. Returns `Ok` if the server has accepted the message. The body of the answer is not read.
pub(super) async fn read(mut stream: impl AsyncRead + Unpin) -> Result<(), Failure> {
    let (mut bytes, mut all) = (Vec::with_capacity(1024), 0);
    loop {
        {
            let mut headers = [EMPTY_HEADER; MOST_HEADERS];
            let mut head = Response::new(&mut headers);
            let parsed = ParserConfig::default()
                .ignore_invalid_headers_in_responses(true)
                .parse_response(&mut head, &bytes);
            match (parsed, head.code) {
                // A server may send interim responses before its answer.
                (Ok(Status::Complete(length)), Some(100..200)) => {
                    bytes.drain(..length);
                    continue;
                }
                (Ok(Status::Complete(_)), Some(code)) => return assessed(code, head.headers),
                (Ok(Status::Partial), _) if all <= LONGEST => {}
                _ => return Err(Failure::NoHttp),
            }
        }
        match stream.read_buf(&mut bytes).await {
            Ok(0) => return Err(Failure::Closed),
            Ok(count) => all += count,
            Err(error) => return Err(Failure::broken(&error)),
        }
    }
}

fn assessed(code: u16, headers: &[Header<'_>]) -> Result<(), Failure> {
    let value = |name: &str| {
        let found = headers.iter().find(|header| header.name.eq_ignore_ascii_case(name))?;
        std::str::from_utf8(found.value).ok()
    };
    match code {
        200..300 => Ok(()),
        300..400 => Err(Failure::Elsewhere(code, value("location").map(shown))),
        _ => {
            let pause = value("retry-after").and_then(|text| text.parse().ok()).map(Duration::from_secs);
            Err(Failure::Answered(code, pause.map(|pause| pause.min(LONGEST_PAUSE))))
        }
    }
}

/// Formats the address of a redirection for a message. Path and query are left out, because they may be secret.
fn shown(location: &str) -> String {
    Url::parse(location).map_or("another path of the same server".to_owned(), |url| url.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn told(text: &str) -> Result<(), Failure> {
        read(text.as_bytes()).await
    }

    #[tokio::test]
    async fn an_answer_is_taken_by_its_code_and_what_is_none_is_refused() {
        assert_eq!(told("HTTP/1.1 204 No Content\r\n\r\n").await, Ok(()));
        assert_eq!(told("HTTP/1.1 100 Continue\r\n\r\nHTTP/1.0 200 OK\r\nA: b\r\n\r\nbody").await, Ok(()));
        let answered =
            |code, pause: Option<u64>| Err(Failure::Answered(code, pause.map(Duration::from_secs)));
        assert_eq!(told("HTTP/1.1 500\r\n\r\n").await, answered(500, None));
        assert_eq!(told("HTTP/1.1 429 Slow\r\nretry-AFTER: 7\r\n\r\n").await, answered(429, Some(7)));
        assert_eq!(told("HTTP/1.1 503 No\r\nRetry-After: 99999999\r\n\r\n").await, answered(503, Some(3600)));
        assert_eq!(told("HTTP/1.1 503 No\r\nRetry-After: Fri, 31 Dec\r\n\r\n").await, answered(503, None));
        for (text, place) in [
            ("HTTP/1.1 302 F\r\nLocation: https://b.example/login?secret=1\r\n\r\n", "https://b.example"),
            ("HTTP/1.1 302 F\r\nLocation: /secret\r\n\r\n", "another path of the same server"),
        ] {
            assert_eq!(told(text).await, Err(Failure::Elsewhere(302, Some(place.to_owned()))));
        }
        for text in [
            "SSH-2.0-OpenSSH_9\r\n",
            "HTTP/2 200\r\n\r\n",
            "HTTP/1.1 abc\r\n\r\n",
            "HTTP/1.1 20\r\n\r\n",
            "HTTP/1.1 100 C\r\n\r\nSSH 200 OK\r\n\r\n",
        ] {
            assert_eq!(told(text).await, Err(Failure::NoHttp), "{text}");
        }
        assert_eq!(told("").await, Err(Failure::Closed));
        assert_eq!(told("HTTP/1.1 200 OK\r\nA: b\r\n").await, Err(Failure::Closed));
        let endless = format!("HTTP/1.1 200 OK\r\nA: {}", "b".repeat(20_000));
        assert_eq!(told(&endless).await, Err(Failure::NoHttp));
        let never = "HTTP/1.1 102 Processing\r\n\r\n".repeat(2000);
        assert_eq!(told(&never).await, Err(Failure::NoHttp));
    }
}
