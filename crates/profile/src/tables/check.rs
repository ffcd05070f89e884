//! State of a check in progress: the tables that are resolved so far.

use std::cell::RefCell;
use std::collections::BTreeMap;

use serde_json::Value;

use super::axis::Axis;
use super::bus::periods::Periods;
use super::bus::{Bus, RawBus};
use super::bus_kind::BusKind;
use super::device::{Device, RawDevice};
use super::output::Output;
use super::raw_profile::RawProfile;
use super::set::OutputSet;
use super::signal::Signal;
use crate::dbc::Dbcs;
use crate::key_context::{KeyContext, Names, Report};
use crate::kinds::can::frame_writes::Written;
use crate::members::Members;
use crate::source_map::SourceMap;
use crate::template::Templates;

/// Tables of one kind: their names, and the tables that have been resolved so far.
pub(crate) struct Tables<T> {
    pub(crate) names: Names,
    /// Resolved tables in the order of the names. An entry is `None` if its table has errors.
    pub(crate) resolved: Vec<Option<T>>,
}

/// Check of a profile in progress: the tables as written, the resolved tables, and the errors.
pub(crate) struct Check<'a> {
    pub(crate) raw: &'a RawProfile,
    /// JSON schema of a profile.
    pub(super) schema: &'a Value,
    pub(crate) report: Report<'a>,
    pub(super) templates: &'a Templates,
    /// All kinds of buses. A line with an invalid type is treated as the first kind.
    pub(super) kinds: &'static [&'static BusKind],
    pub(crate) buses: Tables<Bus>,
    pub(crate) devices: Tables<Device>,
    pub(crate) signals: Tables<Signal>,
    pub(super) axes: Tables<Axis>,
    pub(crate) outputs: Tables<Output>,
    pub(super) sets: Tables<OutputSet>,
    /// Values that outputs write into frames on CAN lines. They are collected while the outputs are resolved.
    pub(crate) written_frames: RefCell<Vec<Written>>,
    pub(crate) dbcs: RefCell<Dbcs>,
    /// Periods of reads and writes on each line.
    pub(super) periods: Periods,
}

impl<T> Tables<T> {
    pub(super) fn of<R>(kind: &'static str, raw: &BTreeMap<String, R>, spans: &SourceMap) -> Tables<T> {
        Tables { names: Names::of(kind, raw, spans), resolved: Vec::new() }
    }

    /// Returns the resolved table at this index. `None` if the table has errors, or has not been resolved yet.
    pub(crate) fn get(&self, place: usize) -> Option<&T> {
        self.resolved.get(place)?.as_ref()
    }

    /// Iterates over the resolved tables that have no errors.
    pub(crate) fn valid(&self) -> impl Iterator<Item = &T> {
        self.resolved.iter().flatten()
    }

    /// Groups the tables without errors by their owners, for example the signals of each device. `owner` returns the
    /// index of the owner; a table for which it returns `None` is left out.
    pub(crate) fn by_owner(&self, owner: impl Fn(&T) -> Option<usize>) -> Members {
        let tables = self.resolved.iter().enumerate();
        tables.filter_map(|(place, table)| Some((owner(table.as_ref()?)?, place))).collect()
    }

    /// Moves all resolved tables out of the list. Returns `None` if any table has errors.
    pub(super) fn whole(&mut self) -> Option<Vec<T>> {
        std::mem::take(&mut self.resolved).into_iter().collect()
    }
}

impl Check<'_> {
    /// Returns the context of a key at the top level of the profile.
    pub(crate) fn at(&self, key: &str) -> KeyContext<'_> {
        self.report.at(key)
    }

    /// Returns the kind of a device's line. `None` if the device or its line is unknown.
    pub(super) fn line_kind(&self, device: Option<&String>) -> Option<&'static BusKind> {
        self.line_kind_of(self.raw.device.get(device?)?)
    }

    /// Returns the kind of a device's line. `None` if the line is unknown.
    pub(super) fn line_kind_of(&self, device: &RawDevice) -> Option<&'static BusKind> {
        self.kind_of_line(self.raw.bus.get(device.bus.as_ref()?)?)
    }

    /// Returns the kind of a line. If the `type` of the line is invalid, its other keys show the kind. `None` if the
    /// other keys do not show the kind either.
    pub(super) fn kind_of_line(&self, line: &RawBus) -> Option<&'static BusKind> {
        self.kinds.iter().copied().find(|kind| match line.kind {
            Some(of) => kind.line_type(of).is_some(),
            None => (kind.recognises)(line),
        })
    }

    /// Iterates over all kinds of buses except this one.
    pub(super) fn kinds_beside(&self, own: &'static BusKind) -> impl Iterator<Item = &'static BusKind> {
        self.kinds.iter().copied().filter(move |kind| !std::ptr::eq(*kind, own))
    }

    /// Returns the bus of a device. `None` if the bus has errors.
    pub(crate) fn bus_of(&self, device: &Device) -> Option<&Bus> {
        self.buses.get(device.bus.0)
    }
}
