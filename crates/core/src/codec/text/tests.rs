use proptest::prelude::*;

use super::*;

fn pattern(text: &str) -> TextPattern {
    text.parse().unwrap_or_else(|why| panic!("{text}: {why}"))
}

/// Answer of an I-7018 with eight channels, from its manual.
const EIGHT: &str = ">+05.123+04.153+07.234-02.356+10.000-05.133+02.345+08.234";

/// Checks the values of lines that the manuals of devices show.
#[test]
fn lines_of_manuals_have_their_values() {
    for (text, line, value) in [
        // HEIDENHAIN ND 281 B: sign, ten characters, blank, unit, sorting, series.
        ("{number}  {any 2}", "-      5.23  =A", Ok(-5.23)),
        ("{number}  {any 2}", "+  12.3456    ", Ok(12.3456)),
        ("{number}  {any 2}", "-      5.23 \"=A", Err(Reason::BadReply)),
        ("{number}  {any 2}", "-      5.23 ?  ", Err(Reason::BadReply)),
        ("\u{2}{number}", "\u{2}+123456789", Ok(123_456_789.0)),
        // Sylvac OPTO-RS: sign, digits, carriage return; errors.
        ("{number.3}", "+012.345", Ok(12.345)),
        ("{number.3}", " 12.345", Ok(12.345)),
        ("{number.3}", "+0.48602", Err(Reason::BadReply)),
        ("{number.3}", "ERR0", Err(Reason::BadReply)),
        // ICP DAS I-7018: eight channels in one answer.
        (">{number}{any}", EIGHT, Ok(5.123)),
        (">{skip 3}{number}{any}", EIGHT, Ok(-2.356)),
        (">{skip 7}{number}{any}", EIGHT, Ok(8.234)),
        (">{skip 8}{number}{any}", ">+05.123+04.153", Err(Reason::BadReply)),
        (">{number}", ">4C53", Err(Reason::BadReply)),
        (">{number}", "?01", Err(Reason::BadReply)),
        ("{number,} mm", "  -0,25 mm", Ok(-0.25)),
        ("{number,2} mm", "1.000,25 mm", Err(Reason::BadReply)),
        ("X ={number} mm {any}", "X =+  0.0012 mm R", Ok(0.0012)),
        ("{any},{skip},{number}", "gauge 4,1,2.5", Ok(2.5)),
        ("{number}", "-1.5E-03", Ok(-0.0015)),
        ("{number}", "12.", Ok(12.0)),
        ("{number}", ".25", Ok(0.25)),
    ] {
        assert_eq!(pattern(text).read(line), value, "{text} on {line}");
    }
}

#[test]
fn a_part_of_a_number_is_no_number() {
    for (text, line) in [
        ("{any}{number.0}", "+123.456"),
        ("{any}{number}", "1,234.5"),
        ("{any 1}{number}", "-12.5"),
        ("{any 2}{number}", "12345.6"),
        ("{number}{any}", "45.00.01"),
        ("{number}{any}", "1,5 mm"),
        ("{skip}{number}", "1.2.3"),
        ("{skip 2}{number}", "1.2.3.4"),
        ("{number}", "12.34.56"),
        ("{number}", "12\u{0}345"),
        ("{number}", ""),
        ("{number}", "+"),
        ("{number}", "1e999"),
    ] {
        assert_eq!(pattern(text).read(line), Err(Reason::BadReply), "{text} on {line}");
    }
}

#[test]
fn a_number_that_has_lost_a_character_has_another_width() {
    for (text, line, damaged) in [
        ("{number.3 8}", "+112.345", &["112.345", "+12.345", "+112345", "+112.34"][..]),
        ("{number 8} mm", "-112.345 mm", &["112.345 mm", "-12.345 mm", "-112345 mm", "-112.34 mm"]),
        ("{number,3 8}", "+112,345", &["112,345", "+12,345"]),
        ("{number 11}  {any 2}", "-    125.23  =A", &["    125.23  =A", "-    12.23  =A"]),
        (
            ">{skip}{number 7}{any}",
            ">+05.123-12.345+10.000",
            &[">+05.123-2.345+10.000", ">+05.123-12345+10.000", ">+05.12312.345+10.000"],
        ),
    ] {
        let pattern = pattern(text);
        assert!(pattern.read(line).is_ok(), "{text} on {line}");
        assert_eq!(pattern.to_string(), text);
        for line in damaged {
            assert_eq!(pattern.read(line), Err(Reason::BadReply), "{text} on {line}");
        }
    }
    for (text, value, line) in [
        ("{number 7}", 25.12, "+25.120"),
        ("{number 7}", -125.12, "-125.12"),
        ("{number 7}", 1372.06, "+1372.1"),
        ("{number.3 9}", 1.5, "+0001.500"),
        ("{number 3}", 1372.0, "+1372"),
    ] {
        assert_eq!(pattern(text).line(value), line, "{text}");
    }
}

#[test]
fn a_pattern_distinguishes_units_by_decimals_or_by_the_characters_behind_the_value() {
    for (text, expected) in [
        ("{number}", false),
        ("{number 8}", false),
        ("X {number}{any}", false),
        ("{number.3}", true),
        ("{number.3}{any}", true),
        ("{number} mm", true),
        ("{number 11}  {any 2}", true),
    ] {
        assert_eq!(pattern(text).distinguishes_units(), expected, "{text}");
    }
}

#[test]
fn the_checksum_is_that_of_dcon() {
    assert_eq!(with_sum("$012{sum}\r"), Ok("$012B7\r".to_owned()), "the example of the manuals");
    assert_eq!(with_sum("?\r"), Ok("?\r".to_owned()));
    assert!(with_sum("#{unit}\r").unwrap_err().contains("unknown word in braces; a request may contain"));
    assert_eq!(with_unit("#{unit}{sum}\r", 0x1f), "#1F{sum}\r");
    let answer = pattern(">{number}{any}{sum}");
    let line = answer.line(25.125);
    assert_eq!(answer.read(&line), Ok(25.125));
    assert_eq!(answer.read(&line.replacen('5', "6", 1)), Err(Reason::Checksum));
    assert_eq!(answer.read(">"), Err(Reason::BadReply));
    assert_eq!(pattern("!01{number}{sum}").read("!01+1.0"), Err(Reason::Checksum));
}

#[test]
fn a_wrong_pattern_is_rejected_with_its_mistake() {
    for (text, words) in [
        ("mm", "has no {number}; write {number}"),
        ("{skip}", "has no {number}"),
        ("{number} {number}", "several values; write {number} once"),
        ("{any}{number}{any}", "several {any}; write it once"),
        ("{number", "no matching brace; write"),
        ("number}", "no matching brace; write"),
        ("{nummer}", "`{nummer}` is unknown; write"),
        ("{number.}", "`{number.}` is unknown"),
        ("{number.10}", "`{number.10}` is unknown"),
        ("{number 0}", "`{number 0}` is unknown"),
        ("{number.3 3} mm", "too few characters for its decimals; count"),
        ("{number} mm\r\n", "contains a line end (carriage return, line feed); leave out \\r and \\n"),
        (
            "{number} \u{3bc}m",
            "a device cannot send `\u{3bc}`, because a character has eight bits; write {any 1}",
        ),
        ("{number 3.4}", "`{number 3.4}` is unknown"),
        ("{nummer 3}", "`{nummer 3}` is unknown"),
        ("{skip 999}{number}", "`{skip 999}` is unknown"),
        ("{sum}{number}", "write {sum} last"),
    ] {
        let why = text.parse::<TextPattern>().unwrap_err();
        assert!(why.contains(words), "{text}: {why}");
    }
    let long = "{number}".to_owned() + &"{skip}".repeat(64);
    assert!(long.parse::<TextPattern>().unwrap_err().contains("more than 64 parts"));
}

#[test]
fn a_value_is_shown_as_a_profile_writes_it() {
    let value = TextValue { request: "#01\r".to_owned(), pattern: pattern(">{number} \"") };
    assert_eq!(value.to_string(), r##"text ">{number} \"" after "#01\r""##);
    assert_eq!(Quoted("\u{2}\\\n\t").to_string(), r#""\u0002\\\n\t""#);
    assert_eq!(TextValue { request: String::new(), ..value }.to_string(), r#"text ">{number} \"""#);
}

#[test]
fn all_values_of_one_answer_are_read_by_the_patterns_that_skip_others() {
    let values = [25.12, -1.5, 1372.0, 0.0];
    let line = pattern(">{skip 2}{number}{any}").line_of_all(&values).unwrap();
    assert_eq!(line, ">+025.120-001.500+1372.000+000.000");
    for (place, value) in values.into_iter().enumerate() {
        let of_place = pattern(&format!(">{{skip {place}}}{{number}}{{any}}"));
        assert_eq!((of_place.read(&line), of_place.skipped()), (Ok(value), place));
    }
    assert_eq!(pattern("X{number} mm").line_of_all(&values), None);
}

#[test]
fn a_pattern_like_a_line_reads_the_number_with_decimals() {
    for (line, expected) in [
        ("+012.345 mm", Some("{number.3} mm")),
        ("X =-  0.5", Some("X ={number.1}")),
        ("   -12.35", Some("{number.2}")),
        ("X  -12.35 mm", Some("X{number.2} mm")),
        ("01A+0001.25", Some("01A{number.2}")),
        ("  17", Some("{number}")),
        (">+25.12+23.40", Some(">{number.2}{any}")),
        ("+12,345 mm", Some("{number,3} mm")),
        ("T1,21.5", Some("T1,{number.1}")),
        ("X,12", Some("X,{number}")),
        ("10,20,30", None),
        ("no number", None),
        ("{1.5}", None),
    ] {
        let found = TextPattern::like(line).map(|pattern| pattern.to_string());
        assert_eq!(found.as_deref(), expected, "{line}");
    }
}

proptest! {
    #[test]
    fn any_line_is_read_or_rejected(text in "[{}a-z0-9., +>]{0,24}", line in "\\PC{0,40}") {
        if let Ok(pattern) = text.parse::<TextPattern>() {
            if let Ok(value) = pattern.read(&line) {
                prop_assert!(value.is_finite());
            }
            prop_assert_eq!(pattern.to_string(), text);
        }
        let _ = TextPattern::like(&line);
    }

    #[test]
    fn a_rendered_line_is_read_as_its_value(
        before in "[A-Z=> ]{0,4}",
        skip in 0_u16..4,
        behind in "( mm|\\{any\\}|\\{sum\\})?",
        thousandths in -999_999_i32..999_999,
    ) {
        let pattern: TextPattern =
            format!("{before}{{skip {skip}}}{{number.3}}{behind}").parse().map_err(TestCaseError::fail)?;
        let value = f64::from(thousandths) / 1000.0;
        let read = pattern.read(&pattern.line(value));
        prop_assert!(read.is_ok_and(|read| (read - value).abs() < 5e-4), "{read:?}");
    }

    #[test]
    fn a_number_is_the_one_that_rust_reads(number in "[+-]?[0-9]{1,9}(\\.[0-9]{1,9})?") {
        let read = pattern("{number}").read(&number);
        prop_assert_eq!(read, Ok(number.parse::<f64>().unwrap()));
    }
}
