//! Preview of the MQTT publication: broker, periods, topics and accepted commands.

use super::{Mqtt, MqttFormat};
use crate::Profile;
use crate::document::{Section, entries};
use crate::duration::shown;

impl Mqtt {
    /// Returns the preview of the publication: broker, content, periods, and accepted commands.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let mut section = Section::default();
        let (broker, machine) = (self.broker.to_string(), &profile.name);
        let user = self.user.as_ref().map(|user| user.name.as_str());
        let speaks = user.map_or("as the anonymous user".to_owned(), |user| format!("as user {user}"));
        let trusts = match (&self.ca, self.broker.tls) {
            (_, false) => "in plain text".to_owned(),
            (Some(ca), true) => format!("trusting {}", ca.name),
            (None, true) => "trusting the certificate authorities of this computer".to_owned(),
        };
        let shows = self.own.as_ref().map(|(cert, _)| cert.name.as_str());
        let with = shows.map_or(String::new(), |cert| format!(", own certificate {cert}"));
        section.line(format!("  to {broker}, {speaks}, {trusts}{with}"));
        let topics = self.topics(profile);
        let (every, refresh) = (shown(self.every), shown(self.refresh));
        section.line(format!(
            "  changed values at most every {every}, all values at least every {refresh}; each event once"
        ));
        section.lines("    ", &topics);
        if let Some(host) = &self.primary_host {
            section.line(format!(
                "  waits for the host {host}: while it is offline, values are stored on disk, and published later"
            ));
        }
        let asked = self.asked(machine);
        let measured = "measured errors of axes with `probe`";
        section.line(match (&asked, self.format) {
            (None, _) => "  accepts no commands: the gateway subscribes to no topic".to_owned(),
            (Some(topic), MqttFormat::Json) => {
                format!("  accepts {measured} at {topic}; refuses everything else")
            }
            (Some(topic), MqttFormat::SparkplugB) => {
                let measured = if self.takes_measured { format!(", {measured}") } else { String::new() };
                format!(
                    "  accepts a host's request for a new birth message{measured} at {topic}; refuses \
                     everything else"
                )
            }
        });
        entries!(section, broker, format = self.format, user, trusts = self.ca.as_ref().map(|ca| &ca.name));
        entries!(section, shows, every, refresh, topics, takes = asked, home_assistant = self.home_assistant);
        entries!(section, primary_host = &self.primary_host);
        section
    }

    fn topics(&self, profile: &Profile) -> Vec<String> {
        let (group, machine) = (&self.group, &profile.name);
        if self.format == MqttFormat::SparkplugB {
            let kinds = ["NBIRTH", "NDATA", "NDEATH"];
            return kinds.iter().map(|kind| format!("spBv1.0/{group}/{kind}/{machine}")).collect();
        }
        let named = |kind: &str, names: Vec<&str>| match names.as_slice() {
            [] => None,
            [only] => Some(format!("{group}/{machine}/{kind}/{only}")),
            [first, .., last] => Some(format!(
                "{group}/{machine}/{kind}/{first} … {group}/{machine}/{kind}/{last} ({})",
                names.len()
            )),
        };
        let of = [
            named("axis", profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect()),
            named("signal", profile.signals.iter().map(|signal| signal.name.as_str()).collect()),
            named("output", profile.outputs.iter().map(|output| output.name.as_str()).collect()),
            named("device", profile.devices.iter().map(|device| device.name.as_str()).collect()),
            named("bus", profile.buses.iter().map(|bus| bus.name.as_str()).collect()),
        ];
        let ends = [
            Some(format!(
                "{group}/{machine}/event (not retained by the broker; all other topics are retained)"
            )),
            self.home_assistant.then(|| format!("homeassistant/+/isotherm-{machine}/+/config")),
        ];
        let state = [format!("{group}/{machine}/state"), format!("{group}/{machine}/gateway")];
        state.into_iter().chain(of.into_iter().chain(ends).flatten()).collect()
    }

    /// Returns the topic on which the gateway receives commands. `None` if it accepts no commands.
    fn asked(&self, machine: &str) -> Option<String> {
        let group = &self.group;
        match self.format {
            MqttFormat::Json => self.takes_measured.then(|| format!("{group}/{machine}/command/measured")),
            MqttFormat::SparkplugB => Some(format!("spBv1.0/{group}/NCMD/{machine}")),
        }
    }
}
