//! Selects by name the log columns that each command uses. The other columns are not read completely.

use crate::ambient::is_named_for_the_air;
use crate::applied::Applied;
use crate::dataset::{Kind, Units};
use crate::drift::is_feed;
use crate::setup::{Choice, units};
use isotherm_profile::Profile;

/// Selects the log columns that `isotherm identify` reads: the signals of the profile, the error, the Cz (compensation
/// value) that was active, touches of a probe, and columns about the machine.
pub fn of_identify<'a>(
    profile: &'a Profile,
    choice: &'a Choice,
    applied: &'a Applied,
) -> impl Fn(&str) -> bool + 'a {
    let (error, touches) = (choice.error_column(profile), choice.touch_columns(profile));
    move |name| {
        profile.signals.iter().any(|signal| signal.name == name)
            || name == error
            || touches.iter().any(|touches| name == touches)
            || applied.names(name)
            || is_named_for_the_air(name)
            || matches!(Kind::of_name(name, units(profile)(name)), Some(Kind::Speed | Kind::Position))
    }
}

/// Selects the log columns that `isotherm select` reads: the measuring points, the error, the Cz (compensation value)
/// that was active, and speeds. Without `choice.inputs`, every column that may be a temperature is a point.
pub fn of_select<'a>(choice: &'a Choice, applied: &'a Applied) -> impl Fn(&str) -> bool + 'a {
    move |name| {
        let is_named = |names: &[String]| names.iter().any(|known| known == name);
        let is_point = match (choice.inputs.as_slice(), Kind::of_name(name, None)) {
            (_, Some(Kind::Speed)) => true,
            ([], kind) => kind.is_none_or(|kind| kind == Kind::Temperature),
            (inputs, _) => is_named(inputs),
        };
        is_point
            || choice.error.as_deref() == Some(name)
            || applied.names(name)
            || is_named(&choice.without)
            || is_named(&choice.keep)
    }
}

/// Selects the log columns that `isotherm report` reads: displacements, temperatures, and columns that show a rotation
/// or movement. Columns of loads, pressures and switches are not read.
pub fn of_report<'a>(
    displacements: &'a [String],
    applied: &'a Applied,
    units: Units<'a>,
) -> impl Fn(&str) -> bool + 'a {
    move |name| {
        !matches!(Kind::of_name(name, units(name)), Some(Kind::Other | Kind::Switch))
            || is_feed(name, units(name))
            || displacements.iter().any(|known| known == name)
            || applied.names(name)
    }
}
