//! Values that were published last. A comparison with the current values finds the changes.

use isotherm_core::quantity::Moment;

use super::birth::{EVENT, GOOD, add_property, add_quality, has_quality, kind_of, milliseconds, named, null};
use super::datum::{DataType, Datum};
use super::payload::Metric;
use crate::interface::{PlantEvent, Snapshot, Subject, Value};

/// Maximum shift of the time stamp of an event, in ms. A time stamp is shifted to be later than the time stamp of the
/// previous event. Some hosts store only one value for each time, so events need different times.
const APART_WITHIN_MS: u64 = 1000;

/// Last value of each metric that was published, or stored on disk for later.
#[derive(Debug, Default)]
pub(super) struct PublishedMetrics {
    figures: Vec<Figure>,
    last_event_ms: u64,
}

#[derive(Debug)]
struct Figure {
    subject: Subject,
    name: &'static str,
    kind: DataType,
    last: Last,
}

#[derive(Debug)]
enum Last {
    Nothing,
    Unknown,
    Value(Value),
}

impl PublishedMetrics {
    /// Returns whether the snapshot has the same metrics as the last snapshot, in the same order.
    pub(super) fn is_of(&self, snapshot: &Snapshot) -> bool {
        self.figures.len() == snapshot.metrics.len()
            && self.figures.iter().zip(&snapshot.metrics).all(|(figure, metric)| {
                figure.name == metric.name
                    && figure.subject == metric.subject
                    && figure.kind == kind_of(&metric.kind)
            })
    }

    /// Returns the metrics that have changed, and the metrics of the events, in the order of their time stamps. The
    /// changed values are recorded as published.
    pub(super) fn changes(
        &mut self,
        snapshot: &Snapshot,
        events: &[PlantEvent],
        stamp: Moment,
    ) -> Vec<Metric> {
        if !self.is_of(snapshot) {
            self.figures = snapshot.metrics.iter().map(Figure::of).collect();
        }
        let mut changed = Vec::new();
        for (figure, metric) in self.figures.iter_mut().zip(&snapshot.metrics) {
            let is_new = match (&figure.last, &metric.value) {
                (Last::Nothing, _) | (Last::Unknown, Some(_)) | (Last::Value(_), None) => true,
                (Last::Unknown, None) => false,
                (Last::Value(last), Some(value)) => !value.is_near(last, metric.resolution),
            };
            if !is_new {
                continue;
            }
            let mut published = named(metric, stamp);
            if matches!(figure.last, Last::Unknown)
                && published.is_null.is_none()
                && has_quality(&metric.subject)
            {
                add_quality(&mut published, GOOD);
            }
            figure.last = metric.value.clone().map_or(Last::Unknown, Last::Value);
            changed.push(published);
        }
        changed.extend(self.happened(events));
        changed.sort_by_key(|metric| metric.timestamp);
        changed
    }

    /// Converts events to metrics. Their time stamps differ by at least one millisecond.
    pub(super) fn happened(&mut self, events: &[PlantEvent]) -> Vec<Metric> {
        events.iter().map(|event| self.event(event)).collect()
    }

    fn event(&mut self, event: &PlantEvent) -> Metric {
        let mut published = null(EVENT, DataType::String, event.at);
        let mut at = milliseconds(event.at);
        if at <= self.last_event_ms && self.last_event_ms - at < APART_WITHIN_MS {
            at = self.last_event_ms + 1;
        }
        self.last_event_ms = at;
        published.timestamp = Some(at);
        published.is_null = None;
        published.value = DataType::String.write(&Datum::Text(event.text.clone()));
        add_property(&mut published, "kind", DataType::String, &Datum::Text(event.kind.clone()));
        let importance = Datum::Text(event.importance.name().to_owned());
        add_property(&mut published, "importance", DataType::String, &importance);
        published
    }
}

impl Figure {
    fn of(metric: &crate::interface::Metric) -> Figure {
        let kind = kind_of(&metric.kind);
        Figure { subject: metric.subject.clone(), name: metric.name, kind, last: Last::Nothing }
    }
}
