use proptest::prelude::*;

use super::*;

fn resolve(name: &str) -> Option<Symbol> {
    Some(match name {
        "A" => Symbol::Signal(SignalId(0)),
        "B" => Symbol::Signal(SignalId(1)),
        "t" => Symbol::Time,
        "Kz" => Symbol::Constant(2.4),
        _ => return None,
    })
}

fn value(text: &str) -> f64 {
    let signals = |id: SignalId| [27.5, 24.0].get(id.0).copied();
    Expression::parse(text, &resolve).unwrap().evaluate(&signals, Some(30_000.0)).unwrap()
}

#[test]
fn expressions_mean_what_a_person_means_by_them() {
    for (text, expected) in [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("10 - 4 - 3", 3.0),
        ("-2 ^ 2", -4.0),
        ("2 ^ -1", 0.5),
        ("2 ^ 3 ^ 2", 512.0),
        ("-2 * -3", 6.0),
        ("2e-5 * t", 0.6),
        ("1.5E+1", 15.0),
        ("Kz * (A - B)", 8.4),
        ("sqrt(16) + abs(-1) + min(1, 2) + max(1, 2) + exp(0) + ln(1)", 9.0),
        ("A > 20 and B < 20", 0.0),
        ("A > 20 or B < 20", 1.0),
        ("not A == 3", 1.0),
        ("!(A >= 27.5)", 0.0),
        ("1 - -1", 2.0),
    ] {
        assert!((value(text) - expected).abs() < 1e-12, "{text} = {}", value(text));
    }
}

#[test]
fn an_expression_that_cannot_be_read_says_where_and_why() {
    for (text, at, word) in [
        ("", 0, "ends where a value was expected"),
        ("A +", 3, "ends where a value was expected"),
        ("A B", 2, "operator"),
        ("Kz * (A - C)", 10, "`C` is not known"),
        ("(A", 2, "`)`"),
        ("A = 1", 2, "=="),
        ("sin(A)", 0, "not a function"),
        ("1..2", 0, "not a number"),
        ("A * * B", 4, "value was expected"),
        ("A $ B", 2, "not allowed"),
    ] {
        let error = Expression::parse(text, &resolve).unwrap_err();
        assert_eq!(error.at, at, "{text}: {error:?}");
        assert!(error.message.contains(word), "{text}: {error:?}");
    }
}

#[test]
fn an_absurdly_nested_expression_is_refused() {
    let deep = format!("{}1{}", "(".repeat(10_000), ")".repeat(10_000));
    assert!(Expression::parse(&deep, &resolve).unwrap_err().message.contains("nested"));
    let minus = "-".repeat(10_000) + "1";
    assert!(Expression::parse(&minus, &resolve).unwrap_err().message.contains("nested"));
    let right = (0..100).map(|_| "1+(").collect::<String>() + "1" + &")".repeat(100);
    assert!(Expression::parse(&right, &resolve).is_err());
}

#[test]
fn a_formula_without_a_signal_or_without_machine_on_time_has_no_value() {
    let expression = Expression::parse("A + t", &resolve).unwrap();
    assert_eq!(expression.evaluate(&|_| None, Some(1.0)), Err(Unusable::Signal(SignalId(0))));
    assert_eq!(expression.evaluate(&|_| Some(1.0), None), Err(Unusable::MachineOff));
}

#[test]
fn a_condition_with_a_missing_signal_is_neither_true_nor_false() {
    let condition = Condition::parse("on == 1", &|name| (name == "on").then_some(SignalId(0))).unwrap();
    assert_eq!(condition.holds(&|_| Some(1.0)), Some(true));
    assert_eq!(condition.holds(&|_| Some(0.0)), Some(false));
    assert_eq!(condition.holds(&|_| None), None);
}

#[test]
fn what_is_not_a_number_on_the_way_is_not_one_at_the_end() {
    for text in ["max(0/0, 3)", "min(3, sqrt(-1))", "0/0 > 1", "not (0/0)", "(0/0) ^ 0", "0/0 or 1"] {
        assert!(value(text).is_nan(), "{text} = {}", value(text));
    }
    assert!((value("1 / (1/0)") - 0.0).abs() < 1e-12, "infinity alone does no harm");
}

#[test]
fn a_condition_that_is_not_a_number_does_not_hold_a_door_open() {
    let condition = Condition::parse("on / on", &|name| (name == "on").then_some(SignalId(0))).unwrap();
    assert_eq!(condition.holds(&|_| Some(0.0)), None);
}

proptest! {
    #[test]
    fn no_text_makes_the_parser_panic(text in "[A-Ct0-9+*/^()., =<>!e-]{0,60}") {
        if let Ok(expression) = Expression::parse(&text, &resolve) {
            let _ = expression.evaluate(&|_| Some(1.0), Some(1.0));
        }
    }

    #[test]
    fn any_text_at_all_is_read_or_refused(text in ".{0,80}") {
        let _ = Expression::parse(&text, &resolve);
    }
}
