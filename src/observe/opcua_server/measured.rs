//! Method `measured` of an axis: a client sends a measured error, which corrects the models of the axis. The server has
//! no other command.

use std::sync::Arc;

use ::opcua::types::{StatusCode, UAString, Variant};

use crate::clock::BootClock;
use crate::observe::requester::{ANSWER_TIMEOUT, Channel, Requester};
use crate::observe::status::{Answer, GatewayApi};
use isotherm_core::compensation::MeasuredReport;

/// Receiver of measured errors, which passes them to the gateway.
#[derive(Clone)]
pub(super) struct Measured {
    pub(super) source: Arc<dyn GatewayApi>,
}

impl Measured {
    /// Executes a call of the method by this user. Returns the outputs `done` and `answer`.
    ///
    /// # Errors
    /// The arguments do not have the types of the method.
    pub(super) fn call(
        &self,
        axis: &str,
        arguments: &[Variant],
        user: &str,
    ) -> Result<Vec<Variant>, StatusCode> {
        let (done, answer) = match report(arguments)? {
            Ok(report) => {
                let until = BootClock::default().passed() + ANSWER_TIMEOUT;
                let requester = Requester::new(Channel::OpcUa, user).until(until);
                match self.source.measured(axis, Some(report), &requester) {
                    Ok(answer @ Answer::TooSoon(_)) => (false, answer.text().to_owned()),
                    Ok(answer) => (true, answer.text().to_owned()),
                    Err(why) => (false, why),
                }
            }
            Err(why) => (false, why),
        };
        Ok(vec![Variant::Boolean(done), Variant::String(UAString::from(answer))])
    }
}

/// Parses the arguments of the method. The outer error means a wrong type. The inner error is a sentence about a wrong
/// value.
fn report(arguments: &[Variant]) -> Result<Result<MeasuredReport, String>, StatusCode> {
    let error_um = match arguments.first() {
        Some(Variant::Double(error)) => *error,
        Some(Variant::Float(error)) => f64::from(*error),
        Some(_) => return Err(StatusCode::BadTypeMismatch),
        None => return Err(StatusCode::BadArgumentsMissing),
    };
    let (time, id) = (text(arguments.get(1))?, text(arguments.get(2))?);
    Ok(MeasuredReport::new(error_um, time, id))
}

/// Returns the text of an argument; `None` if the argument is missing or empty.
fn text(argument: Option<&Variant>) -> Result<Option<&str>, StatusCode> {
    match argument {
        None | Some(Variant::Empty) => Ok(None),
        Some(Variant::String(text)) => {
            let text: &str = text.as_ref();
            Ok(Some(text).filter(|text| !text.is_empty()))
        }
        Some(_) => Err(StatusCode::BadTypeMismatch),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_is_a_report_and_what_is_none_is_refused_with_its_reason() {
        let text = |text: &str| Variant::String(UAString::from(text));
        type Expected = Result<(f64, Option<&'static str>), &'static str>;
        let cases: [(&[Variant], Expected); 4] = [
            (&[Variant::Double(3.5)], Ok((3.5, None))),
            (&[Variant::Float(2.5), text(""), text("part-17/2")], Ok((2.5, Some("part-17/2")))),
            (&[Variant::Double(1.0), text("yesterday")], Err("write `time` as")),
            (&[Variant::Double(1.0), text(""), text("two words")], Err("write `id` as")),
        ];
        for (arguments, expected) in cases {
            match (report(arguments).unwrap(), expected) {
                (Ok(found), Ok((error, id))) => {
                    assert!((found.error_um - error).abs() < 1e-9 && found.id.as_deref() == id, "{found:?}");
                }
                (Err(why), Err(words)) => assert!(why.contains(words), "{why}"),
                (found, _) => panic!("{arguments:?}: {found:?}"),
            }
        }
        assert_eq!(report(&[]), Err(StatusCode::BadArgumentsMissing));
        assert_eq!(report(&[text("3.5")]), Err(StatusCode::BadTypeMismatch));
        assert_eq!(report(&[Variant::Double(1.0), Variant::Boolean(true)]), Err(StatusCode::BadTypeMismatch));
    }
}
