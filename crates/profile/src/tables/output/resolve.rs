//! Resolves and checks a table `[output.*]`.

use super::share::Share;
use super::{Output, RawOutput, Target, writes};
use crate::duration::{Timespan, shown};
use crate::tables::{Check, KeyContext, expression};
use crate::{AxisId, DeviceId};

impl RawOutput {
    pub(crate) fn resolve(&self, check: &Check<'_>, at: &KeyContext<'_>, name: &str) -> Option<Output> {
        let axis = at.key("axis").named(&check.axes.names, self.axis.as_ref());
        self.keeps_pace(check, at);
        let index = at.key("device").named(&check.devices.names, self.device.as_ref());
        let writes = writes::resolve(self.writes, self.position.as_ref(), at);
        let refresh = at.key("refresh").period(self.refresh);
        let when = expression::condition(&at.key("when"), self.when.as_ref(), None);
        let known = check.line_kind(self.device.as_ref());
        if let Some(why) = known.and_then(|kind| kind.only_read) {
            let help = "write the name of the device that receives the value, usually the control";
            return at.key("device").reject(why, help);
        }
        if let Some((kind, device)) = known.zip(self.device.as_ref()) {
            (kind.foreign_output_keys)(self, at, device);
        }
        let kind = known.unwrap_or(check.kinds[0]);
        let Target { address, encoding, verify, share, applied, display } =
            (kind.output)(check, self, at, name, index)?;
        if share == Share::Ledger && refresh.is_some() {
            let message = "a shared register is not refreshed: writing the same value again could overwrite \
                           a change by the operator";
            let help = "remove `refresh`: the gateway reads the register once in each `every` of its axis";
            at.key("refresh").warn_key(message, Some(help));
        }
        Some(Output {
            name: name.to_owned(),
            axis: AxisId(axis?),
            device: DeviceId(index?),
            address,
            encoding,
            writes: writes?,
            verify,
            refresh: refresh.filter(|_| share == Share::Whole),
            when,
            set: None,
            boot_counter: None,
            share,
            applied,
            display,
            stated: None,
        })
    }

    /// Reports an axis that moves faster than the control can follow. Otherwise the control would lag behind without
    /// any message.
    fn keeps_pace(&self, check: &Check<'_>, at: &KeyContext<'_>) {
        let most = at.key("largest_step").positive(self.largest_step);
        let least = at.key("shortest_every").duration(self.shortest_every);
        let Some(name) = &self.axis else { return };
        let Some(axis) = check.raw.axis.get(name) else { return };
        let device = self.device.as_deref().unwrap_or_default();
        let of_axis = at.top("axis").key(name);
        if let Some((most, step)) = most.zip(axis.step).filter(|(most, step)| step > most) {
            let message = format!(
                "a step of {step} µm is larger than {most} µm, the largest step that `{device}` can follow"
            );
            of_axis.key("step").invalid(message, format!("write step = {most:?} or less"));
        }
        let every = axis.every.map(|Timespan(every)| every);
        if let Some((least, every)) = least.zip(every).filter(|(least, every)| every < least) {
            let (least, every) = (shown(least), shown(every));
            let message = format!(
                "`{device}` can follow one update every {least}, but the axis is updated every {every}"
            );
            of_axis.key("every").invalid(message, format!("write every = \"{least}\" or longer"));
        }
    }
}
