//! Blocking reads of sensors, each on a separate thread with a common timeout.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::mpsc::unbounded_channel;

use super::find::find;
use super::value;
use crate::clock::WallTimeout;
use isotherm_core::codec::PcSensor;
use isotherm_core::reading::Reason;

/// Reads sensors, and keeps a list of the sensors whose last read has not returned.
#[derive(Clone, Debug, Default)]
pub struct Readers(Arc<Mutex<BTreeSet<PcSensor>>>);

/// Read of a sensor that has not returned yet. After this value is dropped, the sensor may be read again.
struct UnderWay {
    readers: Readers,
    sensor: PcSensor,
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        self.readers.under_way().remove(&self.sensor);
    }
}

impl Readers {
    fn under_way(&self) -> MutexGuard<'_, BTreeSet<PcSensor>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin(&self, sensor: &PcSensor) -> Option<UnderWay> {
        let is_free = self.under_way().insert(sensor.clone());
        is_free.then(|| UnderWay { readers: self.clone(), sensor: sensor.clone() })
    }

    /// Reads all of these sensors at once, and waits for at most `within`. Returns for each sensor its value in °C, or
    /// the reason why it has none, in the same order. A sensor whose previous read has not returned gets the reason
    /// timeout.
    pub async fn read(
        &self,
        root: &Path,
        sensors: &[PcSensor],
        within: Duration,
        patience: &mut WallTimeout,
    ) -> Vec<Result<f64, Reason>> {
        let mut found: Vec<Result<f64, Reason>> = vec![Err(Reason::Timeout); sensors.len()];
        let (sender, mut receiver) = unbounded_channel();
        for (place, sensor) in sensors.iter().enumerate() {
            if sensors[..place].contains(sensor) {
                continue;
            }
            let Some(under_way) = self.begin(sensor) else { continue };
            let (sender, root) = (sender.clone(), root.to_owned());
            let read = move || {
                let sensor = under_way.sensor.clone();
                let value = find(&root, &sensor).and_then(|file| value::read(&file, &sensor));
                // Release the sensor before its value is sent, because the receiver may read it again.
                drop(under_way);
                let _ = sender.send((sensor, value));
            };
            if std::thread::Builder::new().name("sensor".to_owned()).spawn(read).is_err() {
                found[place] = Err(Reason::Unreadable);
            }
        }
        drop(sender);
        let gathering = async {
            while let Some((sensor, value)) = receiver.recv().await {
                let same = found.iter_mut().zip(sensors).filter(|(_, other)| **other == sensor);
                same.for_each(|(found, _)| *found = value);
            }
        };
        let _ = patience.within(within, gathering).await;
        found
    }
}
