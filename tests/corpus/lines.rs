//! Target for lines of text and frames of Modbus ASCII: the pattern and the request of a profile, and the bytes of a
//! device.

use isotherm::fieldbus::kinds::serial_ascii::lines::{LONGEST, LineBuffer};
use isotherm_core::codec::{AsciiFrames, TextPattern, with_sum};

/// Parses a pattern and a request, and reads the bytes of a device. The three parts are separated by zeros.
pub(crate) fn text(data: &[u8]) {
    let mut parts = data.splitn(3, |byte| *byte == 0);
    let [pattern, request, bytes] = std::array::from_fn(|_| parts.next().unwrap_or_default());
    if let Ok(request) = std::str::from_utf8(request)
        && let Ok(sent) = with_sum(request)
    {
        assert!(!sent.contains(['{', '}']), "{request:?} became {sent:?}");
    }
    let mut rtu = Vec::new();
    AsciiFrames::default().push(bytes, &mut rtu);
    assert!(rtu.len() <= bytes.len(), "{bytes:?} became {rtu:?}");
    let pattern = std::str::from_utf8(pattern).ok().and_then(|text| text.parse::<TextPattern>().ok());
    let mut buffer = LineBuffer::new(if request.len().is_multiple_of(2) { 8 } else { 7 });
    if pattern.is_some() {
        buffer.begin();
    }
    buffer.push(bytes);
    while let Some(line) = buffer.pop() {
        assert!(!line.is_empty() && line.chars().count() <= LONGEST, "{line:?}");
        if let Some(Ok(value)) = pattern.as_ref().map(|pattern| pattern.read(&line)) {
            assert!(value.is_finite(), "{line:?} has the value {value}");
        }
        if let Some(like) = TextPattern::like(&line) {
            assert!(like.read(&line).is_ok(), "{like} does not read {line:?}");
        }
    }
    if let Some(pattern) = pattern {
        assert_eq!(pattern.to_string().parse(), Ok(pattern.clone()));
        let _ = (pattern.line(-1.5), pattern.line_of_all(&[1.0, 2.0]), pattern.skipped());
    }
}
