//! Displays, and controls that follow only so fast.

use super::{Check, Zero, shown};
use crate::place::{child, element};
use crate::raw::{RawBeside, RawOutput, RawStale, WritesWord};
use crate::{Beside, Device, Display, Stale};
use isotherm_core::codec::DataType;

/// Most decimals that a digit display has.
const MOST_DECIMALS: u8 = 5;

impl Check<'_> {
    /// What a display is given besides the value.
    pub(super) fn display(&mut self, path: &str, raw: &RawOutput, device: Option<&Device>) -> Display {
        let is_corrected = raw.writes == Some(WritesWord::Corrected);
        for (key, there) in [("beside", raw.beside.is_some()), ("stale", raw.stale.is_some())] {
            if there && raw.writes.is_some() && !is_corrected {
                let help = "remove it, or write writes = \"corrected\"";
                self.wrong_key(&child(path, key), "only a display of a corrected position has this", help);
            }
        }
        let at = child(path, "beside");
        let words = raw.beside.iter().flatten().enumerate();
        let beside = words
            .filter_map(|(place, word)| self.beside(&element(&at, place), word, raw.scale, device))
            .collect();
        let stale = raw.stale.as_ref().and_then(|stale| self.stale(&child(path, "stale"), stale, device));
        Display { beside, stale }
    }

    fn beside(
        &mut self,
        path: &str,
        raw: &RawBeside,
        scale: Option<f64>,
        device: Option<&Device>,
    ) -> Option<Beside> {
        let at = child(path, "register");
        let register = self.holding(&at, raw.register.as_ref()?)?.offset;
        if let Some(device) = device {
            self.writable(&at, 1, device);
        }
        let by_state = raw.good.zip(raw.fault);
        let kinds = [raw.value.is_some(), raw.decimals.is_some(), by_state.is_some()];
        if kinds.iter().filter(|there| **there).count() != 1 {
            let help = "write one of: value = 0; decimals = 256; good = 1, degraded = 2, fault = 3";
            self.wrong_key(path, "it takes one way to say which word this is", help);
            return None;
        }
        if let Some((good, fault)) = by_state {
            return Some(Beside { register, good, degraded: raw.degraded.unwrap_or(good), fault });
        }
        let word = match (raw.value, raw.decimals) {
            (Some(value), _) => value,
            (None, times) => u16::from(self.decimals(path, scale)?).saturating_mul(times.unwrap_or(1)),
        };
        Some(Beside { register, good: word, degraded: word, fault: word })
    }

    fn stale(&mut self, path: &str, raw: &RawStale, device: Option<&Device>) -> Option<Stale> {
        let register = self.holding(&child(path, "register"), raw.register.as_ref()?)?.offset;
        let text = raw.text.clone()?;
        if text.is_empty() || !text.bytes().all(|byte| (0x20..0x7f).contains(&byte)) {
            let help = "write characters that a display has, as \"----\"";
            self.wrong(&child(path, "text"), format!("`{text}` cannot be shown"), help);
            return None;
        }
        let words = Stale::words(&text, raw.characters.unwrap_or(2));
        let count = u16::try_from(words.len()).unwrap_or(u16::MAX);
        if let Some(device) = device {
            self.writable(&child(path, "register"), count, device);
        }
        Some(Stale { text, register, words })
    }

    /// The type of a digit display has as many decimals as the scale.
    pub(super) fn digits(&mut self, path: &str, raw: &RawOutput, kind: DataType) -> Option<DataType> {
        let DataType::Decimal24(_) = kind else { return Some(kind) };
        if raw.scale.is_none() {
            return Some(kind);
        }
        self.decimals(&child(path, "scale"), raw.scale).map(DataType::Decimal24)
    }

    fn decimals(&mut self, path: &str, scale: Option<f64>) -> Option<u8> {
        let scale = scale?;
        let near = |decimals: &u8| (scale * 10f64.powi(i32::from(*decimals)) - 1.0).abs() < 1e-9;
        let found = (0..=MOST_DECIMALS).find(near);
        if found.is_none() {
            let message = format!("{scale} is no digit of a display");
            self.wrong(path, message, "write `scale` as 1.0, 0.1, 0.01, 0.001, 0.0001 or 0.00001 mm");
        }
        found
    }

    /// A control that follows only so fast would be behind, and nobody would see it.
    pub(super) fn pace(&mut self, path: &str, raw: &RawOutput) {
        let most = self.positive(&child(path, "largest_step"), raw.largest_step);
        let least = self.span(&child(path, "shortest_every"), raw.shortest_every.as_ref(), Zero::Refused);
        let Some((name, axis)) = raw.axis.as_ref().and_then(|name| Some((name, self.raw.axis.get(name)?)))
        else {
            return;
        };
        let device = raw.device.as_deref().unwrap_or_default();
        let at = child("axis", name);
        if let (Some(most), Some(step)) = (most, axis.step)
            && step > most
        {
            let message = format!("a step of {step} µm is more than `{device}` follows at once, {most} µm");
            self.wrong(&child(&at, "step"), message, format!("write step = {most:?} or less"));
        }
        let every = axis.every.as_ref().and_then(|every| humantime::parse_duration(&every.0).ok());
        if let (Some(least), Some(every)) = (least, every)
            && every < least
        {
            let message =
                format!("`{device}` follows one update in {}, not one in {}", shown(least), shown(every));
            self.wrong(
                &child(&at, "every"),
                message,
                format!("write every = \"{}\" or longer", shown(least)),
            );
        }
    }
}
