//! How fields of events stand in their data for programs.

use std::time::Duration;

use serde::Serializer;

use crate::clock::Correction;
use isotherm_core::quantity::Moment;

pub(super) fn in_text<S: Serializer>(moment: &Moment, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(moment)
}

pub(super) fn both_in_text<S: Serializer>(set: &Correction, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map([("from", set.from.to_string()), ("to", set.to.to_string())])
}

pub(super) fn in_seconds<S: Serializer>(span: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(span.as_secs_f64())
}
