//! Catalogue of events. Each kind of event has one entry: its name, its level, the alarm that it raises or ends, its
//! word in `[[notify]]`, its meaning, and what to do.
//!
//! The log, the counters, the alarms, the web page, MQTT, `[[notify]]` and the chapter `docs/events.md` are derived
//! from it. Fields and sentence of an event are in `src/observe/events/event.rs`.

use serde::{Deserialize, Serialize};

/// Word of `[[notify]]`: the register value is not the written one, or is unknown.
pub const UNVERIFIED: &str = "unverified";
/// Word of `[[notify]]`: the time of this computer differs from the expected one.
pub const CLOCK: &str = "clock";

/// Hint for a device or line that does not answer.
const DOES_NOT_ANSWER: &str =
    "is it powered, is its cable plugged in? `isotherm check --online` asks it again";
/// Hint for a device whose answers are lost now and then.
const LOSES_ANSWERS: &str =
    "if this happens often, answers are lost: check the cable, the converter and the load of the device";
/// Hint for a sensor that is bad or rejected.
const LOOK_AT_THE_SENSOR: &str = "look at the sensor, its cable and its channel";
/// Hint for an acknowledge that is up although it must not be.
const DROPS_ACKNOWLEDGE: &str = "does the control's program drop the acknowledge when the strobe drops?";
/// Hint for a strobe or an acknowledge that cannot be read or written.
const MAY_ACCESS: &str = "is the control on, may the gateway read and write this address?";
/// Hint for a certificate that is not valid any more, or soon.
const RENEW: &str =
    "make a new certificate; a running gateway loads it after `isotherm restart PROFILE --keep`";
/// Hint for messages that are lost.
const SEE_EVENTS: &str = "`isotherm events` shows what happened";

/// Severity of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Information.
    Info,
    /// Trouble that the operator should know of.
    Warning,
    /// Trouble that requires an action.
    Error,
}

/// Entry of the catalogue.
#[derive(Clone, Copy)]
struct Entry {
    name: &'static str,
    level: Level,
    may_be_info: bool,
    raises: Option<&'static str>,
    ends: &'static [&'static str],
    word: Option<&'static str>,
    hint: Option<&'static str>,
    meaning: &'static str,
}

const fn info(name: &'static str) -> Entry {
    Entry {
        name,
        level: Level::Info,
        may_be_info: false,
        raises: None,
        ends: &[],
        word: None,
        hint: None,
        meaning: "",
    }
}

const fn warning(name: &'static str) -> Entry {
    Entry { level: Level::Warning, ..info(name) }
}

const fn error(name: &'static str) -> Entry {
    Entry { level: Level::Error, ..info(name) }
}

impl Entry {
    /// Sets that some of the events report no trouble. These have the level [`Level::Info`].
    const fn or_info(self) -> Entry {
        Entry { may_be_info: true, ..self }
    }

    /// Sets the alarm that trouble of this kind raises. `{axis}` is the field `axis` of the event's data.
    const fn raises(self, alarm: &'static str) -> Entry {
        Entry { raises: Some(alarm), ..self }
    }

    /// Sets the alarms that an event of this kind ends.
    const fn ends(self, ends: &'static [&'static str]) -> Entry {
        Entry { ends, ..self }
    }

    /// Sets the word of `[[notify]]` that posts this kind with others.
    const fn word(self, word: &'static str) -> Entry {
        Entry { word: Some(word), ..self }
    }

    /// Sets what to do, for events whose cause has no hint.
    const fn hint(self, hint: &'static str) -> Entry {
        Entry { hint: Some(hint), ..self }
    }
}

/// Declares the kinds of events, and their entries in the same order. The doc comment of a kind is its meaning.
macro_rules! catalogue {
    ($($(#[doc = $meaning:literal])+ $kind:ident = $entry:expr;)+) => {
        /// Kind of an event.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum EventKind {
            $($(#[doc = $meaning])+ $kind,)+
        }

        const ENTRIES: &[Entry] = &[$(Entry { meaning: concat!($($meaning),+), ..$entry }),+];

        impl EventKind {
            /// Every kind, in the order of the catalogue.
            pub const ALL: [EventKind; ENTRIES.len()] = [$(EventKind::$kind),+];
        }
    };
}

// The kinds that most profiles post come first, because the message on an unknown word of `[[notify]]` shows only the
// first part of the list.
catalogue! {
    /// The state of an axis has changed, or the cause of its state.
    AxisState = warning("axis-state").or_info().raises("axis {axis}").ends(&["axis {axis}", "level of axis {axis}"])
        .hint("look at the alarms of the signals, devices and outputs of the axis");
    /// An axis was switched off.
    Disarmed = warning("disarmed").hint("arm the axis when the cause is corrected");
    /// An axis is armed.
    Armed = info("armed").ends(&["model of axis {axis}", "arming of axis {axis}", "belief in state and ledger"]);
    /// An axis cannot be armed.
    ArmRefused = error("arm-refused").raises("arming of axis {axis}").hint("correct the cause, then arm the axis");
    /// A request to arm was withdrawn or has expired.
    ArmEnded = warning("arm-ended").ends(&["arming of axis {axis}"]).hint("arm the axis again if it is needed");
    /// An axis to be armed now waits for another condition.
    WaitsToArm = info("waits-to-arm").ends(&["arming of axis {axis}"]);
    /// An armed axis resumes from its register value after a restart of the control.
    GoesOn = info("goes-on");
    /// A device does not answer properly any more.
    DeviceLost = warning("device-lost").raises("device {device}").hint(DOES_NOT_ANSWER);
    /// A device answers again.
    DeviceBack = info("device-back").ends(&["device {device}"]);
    /// A connection could not be made, or was lost.
    LinkDown = warning("link-down").raises("bus {bus}").hint(DOES_NOT_ANSWER);
    /// A connection works again.
    LinkUp = info("link-up").ends(&["bus {bus}"]);
    /// A CAN line has a fault in its controller, queue or receiver, or another master is on a serial line.
    BusTrouble = warning("bus-trouble").raises("trouble of bus {bus}")
        .hint("is the bus terminated at both ends, has every node the same bitrate?");
    /// The fault of a line has ended.
    BusWell = info("bus-well").ends(&["trouble of bus {bus}"]);
    /// A signal cannot be used any more.
    SignalBad = warning("signal-bad").raises("signal {signal}").hint(LOOK_AT_THE_SENSOR);
    /// A signal can be used again.
    SignalGood = info("signal-good").ends(&["signal {signal}"]);
    /// A write has failed.
    WriteFailed = warning("write-failed").raises("output {output}").word(UNVERIFIED).hint(DOES_NOT_ANSWER);
    /// The register of an output cannot be read.
    ReadFailed = warning("read-failed").raises("output {output}").word(UNVERIFIED).hint(DOES_NOT_ANSWER);
    /// The value that was read back differs from the written one.
    VerifyFailed = error("verify-failed").raises("output {output}").word(UNVERIFIED)
        .hint("does another client write the register, does the control accept values now, do `type` and `scale` fit \
               the register?");
    /// A write was verified after failures.
    Verified = info("verified").ends(&["output {output}", "foreign write to {output}"]);
    /// The control applies another value than the register value.
    NotApplied = error("not-applied").raises("output {output}").word(UNVERIFIED)
        .hint("is the compensation function on in the control, does it need longer than `settle`?");
    /// An external write has changed the register.
    ForeignChange = error("foreign-change").raises("foreign write to {output}")
        .hint("find what changed the offset, correct the value at the control, then arm the axis");
    /// The heartbeat of the gateway is not written.
    HeartbeatFailed = warning("heartbeat-failed").raises("heartbeat at {device}").hint(DOES_NOT_ANSWER);
    /// The heartbeat of the gateway is written again.
    HeartbeatWritten = info("heartbeat-written").ends(&["heartbeat at {device}"]);
    /// The register was back at zero, because the CNC was restarted.
    CncRestarted = warning("cnc-restarted").hint("if the CNC was not restarted, find what sets the register to zero");
    /// The boot counter of a control changed.
    CncBooted = warning("cnc-booted").hint("if the operator did not restart the CNC, check its power supply");
    /// The inputs are outside the region on which the axis's model was identified.
    Extrapolating = warning("extrapolating").raises("inputs of axis {axis}").hint("measure a part");
    /// The inputs are inside the region again, or no model is in use.
    Interpolating = info("interpolating").ends(&["inputs of axis {axis}"]);
    /// The error of a model was above the warning level.
    ModelAges = warning("model-ages").hint("if this happens again, identify the model again");
    /// Probings show that an axis is worse with its model than without compensation.
    Worse = error("worse").raises("compensation of axis {axis}").hint("identify the model again, or disarm the axis");
    /// Probings do not show any more that an axis is worse with its model.
    WorseOver = info("worse-over").ends(&["compensation of axis {axis}"]);
    /// The model requests more than the limit.
    AtLimit = warning("at-limit").hint("are its sensors and references right? If they are, raise axis.{axis}.limit");
    /// The absolute value of Cz is above the warning level.
    Warned = warning("warned").raises("level of axis {axis}")
        .hint("measure a part, and compare the sensors of the axis with each other");
    /// The model requests more than the error level, and is not used any more.
    BeyondError = error("beyond-error").raises("model of axis {axis}")
        .hint("find the cause, for example a faulty sensor, then arm the axis");
    /// A value exceeded the range of its register and was limited.
    Saturated = warning("saturated")
        .hint("check `scale`. If it is right, write to a wider register, or lower the limit of the axis");
    /// A sensor of an axis's model is frozen, or suspected of it. It has a stand-in if one is possible.
    Frozen = warning("frozen").raises("sensor of axis {axis}: {signal}")
        .hint("look at the sensor, its cable and its channel; the axis uses the sensor's own reading again by itself");
    /// A sensor of an axis's model is lost. It has a stand-in if one is possible.
    StoodIn = warning("stood-in").raises("sensor of axis {axis}: {signal}")
        .hint("look at the sensor, its cable and its channel; the axis uses the sensor's own reading again by itself");
    /// A sensor has no stand-in any more.
    StandInOver = info("stand-in-over").ends(&["sensor of axis {axis}: {signal}"]);
    /// The computer's clock was set. Displayed times follow it, counted times do not.
    ClockSet = warning("clock-set").word(CLOCK)
        .hint("if the operator did not set the clock, check the time server of this computer");
    /// The computer's clock does not continue from the end of the last run. The time since then is unknown.
    ClockDoubtful = warning("clock-doubtful").word(CLOCK)
        .hint("set the clock; if the time is lost at each start, replace the battery of the clock");
    /// A certificate of an OPC UA line expires soon.
    CertificateExpires = warning("certificate-expires").raises("certificate {file} of bus {bus}").hint(RENEW);
    /// A certificate of an OPC UA line has expired.
    CertificateExpired = error("certificate-expired").raises("certificate {file} of bus {bus}").hint(RENEW);
    /// A task of the gateway failed. Its axes run the fault action.
    TaskFailed = error("task-failed").raises("task {task}")
        .hint("keep the log of this hour and report the failure; restart the gateway if it does not restart by itself");
    /// A device is not set as the profile expects. Nothing that depends on it is armed.
    NotAsExpected = error("not-as-expected").raises("settings of device {device}")
        .hint("change the setting at the device, or correct the profile; until then, no axis that needs the device is \
               armed");
    /// A device is set as the profile expects again.
    AsExpected = info("as-expected").ends(&["settings of device {device}"]);
    /// A CAN node reports an emergency.
    Emergency = warning("emergency").raises("emergency of device {device}")
        .hint("the manual of the device says what the code means");
    /// An emergency has ended.
    EmergencyOver = info("emergency-over").ends(&["emergency of device {device}"]);
    /// A CAN node was reset, or has stopped for another reason. It is set up and started again.
    NodeReset = warning("node-reset")
        .hint("if the operator did not cause this, check the power supply and the plug of the node");
    /// The interlock of an output is open. Nothing is written.
    Interlocked = info("interlocked");
    /// The interlock of an output is closed again.
    Released = info("released");
    /// The place, scale or owner of an output's register differs from the last run. Its axis is off.
    OutputMoved = error("output-moved").raises("place of output {output}")
        .hint("compare the profile with the control, then arm the axis");
    /// A register that belongs to no output any more contains a verified value of the gateway.
    RegisterLeft = warning("register-left").raises("former register of output {output}")
        .hint("release the register, or correct its value at the control");
    /// A register that belonged to no output was returned to its base value at the operator's request, and verified.
    RegisterReleased = info("register-released").ends(&["former register of output {output}"]);
    /// The operator has armed the axis, and so confirmed the place of this output.
    PlaceConfirmed = info("place-confirmed")
        .ends(&["place of output {output}", "former register of output {output}"]);
    /// The place of a signal differs from the last run. Its references are captured again.
    ReferenceForgotten = warning("reference-forgotten").hint("measure a part");
    /// The URI of a namespace index in the profile is recorded.
    NamespaceRecorded = info("namespace-recorded");
    /// A namespace has another index on the server than in the profile. The server's index is used.
    NamespaceMoved = warning("namespace-moved").hint("write nsu={uri};... in place of ns={from};... in the profile");
    /// The Cz of a corrected position is unknown. It starts at zero.
    PositionFromZero = warning("position-from-zero")
        .hint("compare the position at the display with the scale before a part is made");
    /// The gateway share of a register is uncertain. The operator must confirm it.
    LedgerDoubt = error("ledger-doubt").raises("ledger of {output}")
        .hint("set the register to your own offset, then arm the axis");
    /// A register to be shared has an unknown value that is not zero. The operator must confirm that it is an operator
    /// offset.
    FirstAccount = warning("first-account").raises("ledger of {output}")
        .hint("if the whole value is your own offset, arm the axis; if not, first set the register to your own offset");
    /// The division of a shared register is recorded: operator offset and gateway share.
    LedgerOpened = info("ledger-opened").ends(&["ledger of {output}"]);
    /// The operator has changed the operator offset in a shared register.
    OperatorChange = info("operator-change");
    /// A write of the gateway arrived long after it was sent.
    OwnWriteLate = warning("own-write-late").hint(LOSES_ANSWERS);
    /// A value appeared after a start. It may be a write of the gateway from before the start.
    PerhapsFromBefore = warning("perhaps-from-before")
        .hint("if the gateway did not write the value, disarm the axis and correct the value at the control");
    /// A late write may still arrive, and the next change would be too far from it.
    WaitsForLateWrite = warning("waits-for-late-write").hint(LOSES_ANSWERS);
    /// Writes are acknowledged, but the register cannot be read.
    NotReadBack = info("not-read-back").word(UNVERIFIED);
    /// The acknowledge of the control was up before the strobe, and stayed up.
    AcknowledgeEarly = error("acknowledge-early").hint(DROPS_ACKNOWLEDGE);
    /// The acknowledge of the control did not come.
    AcknowledgeMissing = error("acknowledge-missing")
        .hint("does the control's program run, does it read this strobe? If so, raise `timeout` of the handshake");
    /// The acknowledge of the control could not be read.
    AcknowledgeNotRead = error("acknowledge-not-read").hint(MAY_ACCESS);
    /// The acknowledge of the control did not drop after the strobe.
    AcknowledgeStuck = error("acknowledge-stuck").hint(DROPS_ACKNOWLEDGE);
    /// The strobe could not be raised.
    StrobeNotWritten = error("strobe-not-written").hint(MAY_ACCESS);
    /// The strobe could not be dropped.
    StrobeNotDropped = error("strobe-not-dropped").hint(MAY_ACCESS);
    /// The axis has learned from a measured error.
    Probed = info("probed");
    /// A measured error was refused.
    ProbeRefused = warning("probe-refused").hint("measure again");
    /// The correction from measured errors was discarded.
    ProbeForgotten = info("probe-forgotten");
    /// The operator has reported in which direction a gauge moved when Cz increased. Every direction but plus is
    /// trouble.
    SignChecked = error("sign-checked").or_info()
        .hint("disarm the axis, turn the sign of `scale` at its output, and check again");
    /// A check of the sign has ended without an answer. Cz goes back.
    SignEnded = warning("sign-ended").hint("check the sign again");
    /// A counter was set, referenced or restarted. Nothing moved.
    Rereferenced = warning("rereferenced")
        .hint("if the operator has not referenced the axis, check the encoder and its power supply");
    /// The machine was started. Its running time is counted from now on.
    MachineStarted = info("machine-started");
    /// The "zero" references are captured from now on.
    Zeroed = info("zeroed");
    /// A line has more exchanges than it can carry: one of them was late. The event is reported once, and again after
    /// the line was fast enough in between.
    Overrun = warning("overrun").hint("`isotherm check` shows the load of each bus");
    /// A device does not support two requests at a time: requests to it are sent one by one.
    PipelineGivenUp = warning("pipeline-given-up").hint("remove `pipeline` from the profile");
    /// A server does not support a requested subscription, or not as requested.
    Subscription = warning("subscription")
        .hint("let the server send values as often as `every` says, or write a longer `every`");
    /// The gateway did not run for this time: the computer was stopped, suspended or overloaded.
    StoodStill = warning("stood-still")
        .hint("does another program use the computer, is automatic suspend on? A gateway needs a computer of its own");
    /// The gateway has started.
    Started = info("started");
    /// The gateway was asked to stop. It runs the fault actions, or keeps the register values.
    Stopping = info("stopping");
    /// The gateway has stopped. The sentence lists the values that stay in the registers.
    Stopped = info("stopped");
    /// A device template differs from the one of the last run.
    TemplateChanged = warning("template-changed")
        .hint("compare what `isotherm check` prints before the machine makes parts");
    /// Other gateways on this computer cannot be detected. A second writer of a register would not be rejected.
    NotExclusive = warning("not-exclusive").hint("make sure that only one gateway writes to each register");
    /// The state or the log could not be stored on disk.
    NotKept = warning("not-kept").raises("keeping {what}")
        .hint("free space in that directory, or name another one (`--state`)");
    /// The state or the log can be stored again.
    KeptAgain = info("kept-again").ends(&["keeping {what}"]);
    /// The state or the ledger was rejected: it is damaged, was changed, or is a copy from elsewhere.
    NotBelieved = error("not-believed").raises("belief in state and ledger")
        .hint("compare the registers of the control with what they should hold, then arm the axes");
    /// The handover of the program before this one in the same process was rejected.
    HandoverRefused = warning("handover-refused").hint("arm the axes that are off");
    /// The checked profile runs, but some of its files, variables or settings have changed since.
    ProfileDiffers = warning("profile-differs")
        .hint("to use the changed files: `isotherm restart {profile} --keep`");
    /// The state or the ledger of an earlier version of the program is used.
    TakenFromEarlier = warning("taken-from-earlier");
    /// Events are missing on disk.
    EventsLost = warning("events-lost").hint("is the disk full, slow or broken?");
    /// The file of a day's events is full.
    EventsFull = warning("events-full").hint("`isotherm events` shows which events are so frequent");
    /// Logs were deleted.
    LogsDeleted = info("logs-deleted");
    /// The web page cannot listen at its address.
    PageClosed = warning("page-closed").raises("page at {listen}")
        .hint("free the address or name another one; the gateway tries again every ten seconds, and the compensation \
               continues");
    /// The web page listens now.
    PageOpen = info("page-open").ends(&["page at {listen}"]);
    /// A token file of the web page contains another token.
    TokenChanged = info("token-changed");
    /// A token file of the web page contains no valid token.
    TokenGone = error("token-gone").hint("`isotherm token --out FILE` makes a token file that only its owner can read");
    /// A message to a server of `[[notify]]` could not be delivered. Further failures are not reported until a message
    /// arrives.
    NotifyFailed = warning("notify-failed").raises("messages of {notify}")
        .hint("does the server run, are `url` and token right? The gateway tries a few times more, and the \
               compensation continues");
    /// A message to a server of `[[notify]]` has arrived after failures.
    NotifyBack = info("notify-back").ends(&["messages of {notify}"]);
    /// Messages to a server of `[[notify]]` were given up, or the queue had no room for them.
    NotifyDropped = warning("notify-dropped").hint(SEE_EVENTS);
    /// The connection to the broker of `[mqtt]` is lost.
    BrokerDown = warning("broker-down").raises("broker {broker}")
        .hint("does the broker run, are its address, user and certificate those of `[mqtt]`? The gateway tries again, \
               and the compensation continues");
    /// The connection to the broker of `[mqtt]` is back.
    BrokerUp = info("broker-up").ends(&["broker {broker}"]);
    /// Messages to the broker were dropped, because it was not reachable or too slow.
    BrokerDropped = warning("broker-dropped").hint(SEE_EVENTS);
    /// Data that must be kept for the broker could not be written to disk.
    BrokerNotKept = warning("broker-not-kept")
        .hint("free space in the state directory, and allow the gateway to write to it");
    /// A command was carried out.
    Command = info("command");
    /// A command was refused.
    CommandRefused = warning("command-refused");
    /// A command was dropped, because its sender did not wait for it any more. It will not be carried out.
    CommandDropped = warning("command-dropped").hint("give the command again");
}

impl EventKind {
    const fn entry(self) -> &'static Entry {
        &ENTRIES[self as usize]
    }

    /// Name for programs: one word, and label of the counter.
    pub const fn name(self) -> &'static str {
        self.entry().name
    }

    /// Severity; of the trouble, if [`EventKind::may_be_info`].
    pub const fn level(self) -> Level {
        self.entry().level
    }

    /// Returns whether some events of this kind report no trouble, and have the level [`Level::Info`].
    pub const fn may_be_info(self) -> bool {
        self.entry().may_be_info
    }

    /// Alarm that an event of this kind raises, unless it has the level [`Level::Info`]. `{axis}` is a field of the
    /// event's data.
    pub const fn raises(self) -> Option<&'static str> {
        self.entry().raises
    }

    /// Alarms that an event of this kind ends, if it raises none.
    pub const fn ends(self) -> &'static [&'static str] {
        self.entry().ends
    }

    /// Kinds that end the alarm of this kind.
    pub fn ended_by(self) -> impl Iterator<Item = EventKind> {
        let raised = self.raises();
        EventKind::ALL
            .into_iter()
            .filter(move |kind| raised.is_some_and(|alarm| kind.ends().contains(&alarm)))
    }

    /// Word of `[[notify]]` that posts this kind with others.
    pub const fn word(self) -> Option<&'static str> {
        self.entry().word
    }

    /// Hint for an event whose cause has none. `{axis}` is a field of the event's data.
    pub const fn hint(self) -> Option<&'static str> {
        self.entry().hint
    }

    /// Meaning, in sentences.
    pub const fn meaning(self) -> &'static str {
        self.entry().meaning.trim_ascii()
    }
}

#[cfg(test)]
mod tests;
