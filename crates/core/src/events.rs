//! Catalogue of events. Each kind of event has one entry: name, level, alarms that it raises or ends, word in
//! `[[notify]]`, meaning, and a hint what to do.
//!
//! The log, the counters, the alarms, the web page, MQTT, `[[notify]]` and the chapter `docs/events.md` are derived
//! from the catalogue. `src/observe/events/event.rs` defines the fields and the text of each event.

use serde::{Deserialize, Serialize};

/// Word of `[[notify]]` that selects the events after which a register value differs from the written value, or is
/// unknown.
pub const UNVERIFIED: &str = "unverified";
/// Word of `[[notify]]` that selects the events about a wrong or changed clock of this computer.
pub const CLOCK: &str = "clock";

/// Hint for a device or bus that does not answer.
const DOES_NOT_ANSWER: &str =
    "check the power and the cable of the device; `isotherm check --online` tries to reach it again";
/// Hint for a device whose answers are sometimes lost.
const LOSES_ANSWERS: &str =
    "if this happens often, answers are lost: check the cable, the converter and the load of the device";
/// Hint for a sensor that is bad or rejected.
const LOOK_AT_THE_SENSOR: &str = "check the sensor, its cable and its channel";
/// Hint for an acknowledge signal of the control that is set although it must not be.
const DROPS_ACKNOWLEDGE: &str =
    "check that the control's program drops the acknowledge signal when the strobe signal drops";
/// Hint for a signal of a handshake (strobe or acknowledge) that cannot be read or written.
const MAY_ACCESS: &str = "check that the control is on, and that the gateway may read and write this address";
/// Hint for a certificate that has expired, or expires soon.
const RENEW: &str =
    "make a new certificate; a running gateway loads it after `isotherm restart PROFILE --keep`";
/// Hint for messages that were not delivered.
const SEE_EVENTS: &str = "`isotherm events` shows what happened";

/// Severity of an event, in ascending order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Information: the event reports no trouble.
    Info,
    /// Trouble that the operator should know of.
    Warning,
    /// Trouble that requires an action.
    Error,
}

impl Level {
    /// Returns the name of the severity for programs, for example in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Level::Info => "info",
            Level::Warning => "warning",
            Level::Error => "error",
        }
    }
}

/// Entry of the catalogue: the properties of one kind of event.
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
    /// Marks a kind of event that does not always report trouble. Its events without trouble have the level
    /// [`Level::Info`].
    const fn or_info(self) -> Entry {
        Entry { may_be_info: true, ..self }
    }

    /// Sets the name of the alarm that an event of this kind raises. `{axis}` in the name stands for the field `axis`
    /// of the event's data.
    const fn raises(self, alarm: &'static str) -> Entry {
        Entry { raises: Some(alarm), ..self }
    }

    /// Sets the names of the alarms that an event of this kind ends.
    const fn ends(self, ends: &'static [&'static str]) -> Entry {
        Entry { ends, ..self }
    }

    /// Sets the word of `[[notify]]` that selects several kinds, including this one.
    const fn word(self, word: &'static str) -> Entry {
        Entry { word: Some(word), ..self }
    }

    /// Sets the hint (what to do) for events whose cause has no hint of its own.
    const fn hint(self, hint: &'static str) -> Entry {
        Entry { hint: Some(hint), ..self }
    }
}

/// Declares the kinds of events, and their entries in the same order. The doc comment of a kind is its meaning.
macro_rules! catalogue {
    ($($(#[doc = $meaning:literal])+ $kind:ident = $entry:expr;)+) => {
        /// Kind of an event, for example that an axis was switched off. The catalogue has one entry for each kind.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum EventKind {
            $($(#[doc = $meaning])+ $kind,)+
        }

        const ENTRIES: &[Entry] = &[$(Entry { meaning: concat!($($meaning),+), ..$entry }),+];

        impl EventKind {
            /// All kinds, in the order of the catalogue.
            pub const ALL: [EventKind; ENTRIES.len()] = [$(EventKind::$kind),+];
        }
    };
}

// The kinds that most profiles post come first, because the message on an unknown word of `[[notify]]` shows only the
// first part of the list.
catalogue! {
    /// The state of an axis has changed, or the cause of this state has changed.
    AxisState = warning("axis-state").or_info().raises("axis {axis}").ends(&["axis {axis}", "Cz of axis {axis}"])
        .hint("see the alarms of the signals, devices and outputs of the axis");
    /// An axis was switched off.
    Disarmed = warning("disarmed").hint("arm the axis when the cause is corrected");
    /// An axis is armed.
    Armed = info("armed").ends(&["model of axis {axis}", "arming of axis {axis}", "belief in state and ledger"]);
    /// An axis cannot be armed.
    ArmRefused = error("arm-refused").raises("arming of axis {axis}").hint("correct the cause, then arm the axis");
    /// A request to arm was withdrawn or has expired.
    ArmEnded = warning("arm-ended").ends(&["arming of axis {axis}"]).hint("arm the axis again if it is needed");
    /// An axis with a request to arm now waits for another condition than before.
    WaitsToArm = info("waits-to-arm").ends(&["arming of axis {axis}"]);
    /// An armed axis resumes from its register value after a restart of the control.
    GoesOn = info("goes-on");
    /// A device no longer answers, or its answers are wrong.
    DeviceLost = warning("device-lost").raises("device {device}").hint(DOES_NOT_ANSWER);
    /// A device answers again.
    DeviceBack = info("device-back").ends(&["device {device}"]);
    /// The connection of a bus could not be made, or was lost.
    LinkDown = warning("link-down").raises("bus {bus}").hint(DOES_NOT_ANSWER);
    /// The connection of a bus works again.
    LinkUp = info("link-up").ends(&["bus {bus}"]);
    /// A CAN bus has a fault in its controller, queue or receiver, or a serial line has another master.
    BusTrouble = warning("bus-trouble").raises("trouble of bus {bus}")
        .hint("check that the bus is terminated at both ends, and that every node has the same bitrate");
    /// The fault of a bus or serial line has ended.
    BusWell = info("bus-well").ends(&["trouble of bus {bus}"]);
    /// A signal can no longer be used.
    SignalBad = warning("signal-bad").raises("signal {signal}").hint(LOOK_AT_THE_SENSOR);
    /// A signal can be used again.
    SignalGood = info("signal-good").ends(&["signal {signal}"]);
    /// A write to the register of an output has failed.
    WriteFailed = warning("write-failed").raises("output {output}").word(UNVERIFIED).hint(DOES_NOT_ANSWER);
    /// The register of an output cannot be read.
    ReadFailed = warning("read-failed").raises("output {output}").word(UNVERIFIED).hint(DOES_NOT_ANSWER);
    /// The value that was read back from the register of an output differs from the written one.
    VerifyFailed = error("verify-failed").raises("output {output}").word(UNVERIFIED)
        .hint("check that no other client writes the register, that the control accepts values now, and that `type` \
               and `scale` fit the register");
    /// The register of an output was verified after failures, or after a write that is not from the gateway.
    Verified = info("verified").ends(&["output {output}", "foreign write to {output}"]);
    /// The control applies another value than the register value.
    NotApplied = error("not-applied").raises("output {output}").word(UNVERIFIED)
        .hint("check that the compensation function of the control is on, and that `settle` is long enough for the \
               control");
    /// A write that is not from the gateway has changed the register of an output.
    ForeignChange = error("foreign-change").raises("foreign write to {output}")
        .hint("find what changed the offset, correct the value at the control, then arm the axis");
    /// The gateway cannot write its heartbeat to a device.
    HeartbeatFailed = warning("heartbeat-failed").raises("heartbeat at {device}").hint(DOES_NOT_ANSWER);
    /// The gateway can write its heartbeat to a device again.
    HeartbeatWritten = info("heartbeat-written").ends(&["heartbeat at {device}"]);
    /// The register of an output was zero again, because the CNC was restarted.
    CncRestarted = warning("cnc-restarted").hint("if the CNC was not restarted, find what sets the register to zero");
    /// The boot counter of a control has changed: the control was restarted.
    CncBooted = warning("cnc-booted").hint("if the operator did not restart the CNC, check its power supply");
    /// The inputs of an axis's model are outside the region on which the model was identified.
    Extrapolating = warning("extrapolating").raises("inputs of axis {axis}").hint("measure a part");
    /// The inputs of an axis's model are inside the identified region again, or no model is in use.
    Interpolating = info("interpolating").ends(&["inputs of axis {axis}"]);
    /// The error of a model at a probing was above the warning level.
    ModelAges = warning("model-ages").hint("if this happens again, identify the model again");
    /// Probings show that an axis is worse with its model than without compensation.
    Worse = error("worse").raises("compensation of axis {axis}").hint("identify the model again, or disarm the axis");
    /// Probings no longer show that an axis is worse with its model than without compensation.
    WorseOver = info("worse-over").ends(&["compensation of axis {axis}"]);
    /// A model that was learned from touches is better than the model in use, over the last judged days.
    CandidateBetter = info("candidate-better");
    /// The axis follows another model: a learned model, or again the model of the profile. Cz has not changed.
    ModelAdopted = info("model-adopted");
    /// The models of an axis in the profile have changed, so that its learned model is not used any more.
    ModelSuperseded = warning("model-superseded").hint("adopt a learned model again, if it is better than the new model");
    /// No model could be learned from the touches of the axes.
    LearningFailed = warning("learning-failed").hint("`isotherm learn PROFILE` shows what is wrong");
    /// The model of an axis requests more Cz than the limit of the axis.
    AtLimit = warning("at-limit")
        .hint("check the sensors and references of the axis. If all are right, raise axis.{axis}.limit");
    /// The model of an axis has requested more Cz than the limit of the axis for more than five minutes. The event names
    /// the signals with the largest contributions.
    LimitLasts = warning("limit-lasts").raises("limit of axis {axis}")
        .hint("check the sensors with the largest contributions, and their references. If all are right, raise \
               `limit` of the axis");
    /// Cz of an axis is no longer at its limit: the model requests less, or the axis is off or at zero.
    LimitOver = info("limit-over").ends(&["limit of axis {axis}"]);
    /// The absolute value of an axis's Cz is above the warning level.
    Warned = warning("warned").raises("Cz of axis {axis}")
        .hint("measure a part, and compare the sensors of the axis with each other");
    /// The model of an axis requests more Cz than the error level, and is no longer used.
    BeyondError = error("beyond-error").raises("model of axis {axis}")
        .hint("find the cause, for example a faulty sensor, then arm the axis");
    /// A value for an output exceeded the range of its register and was limited to this range.
    Saturated = warning("saturated")
        .hint("check `scale`. If it is right, use a register with more bits, or lower the limit of the axis");
    /// A sensor of an axis's model is frozen or possibly frozen: its reading does not change. A stand-in (an estimate
    /// from other sensors) replaces the sensor if possible.
    Frozen = warning("frozen").raises("sensor of axis {axis}: {signal}")
        .hint("check the sensor, its cable and its channel; when the sensor works again, the axis uses it \
               automatically");
    /// A sensor of an axis's model is lost. A stand-in (an estimate from other sensors) replaces the sensor if
    /// possible.
    StoodIn = warning("stood-in").raises("sensor of axis {axis}: {signal}")
        .hint("check the sensor, its cable and its channel; when the sensor works again, the axis uses it \
               automatically");
    /// A stand-in (value estimated from other sensors) no longer replaces a sensor: the sensor is accepted again, or
    /// the stand-in cannot be used.
    StandInOver = info("stand-in-over").ends(&["sensor of axis {axis}: {signal}"]);
    /// The computer's clock was set. Displayed times follow the clock; measured intervals do not change.
    ClockSet = warning("clock-set").word(CLOCK)
        .hint("if the operator did not set the clock, check the time server of this computer");
    /// The computer's clock does not continue from the end of the last run. The length of the time between the two runs
    /// is unknown.
    ClockDoubtful = warning("clock-doubtful").word(CLOCK)
        .hint("set the clock; if the time is lost at each start, replace the battery of the clock");
    /// A certificate of an OPC UA bus expires soon.
    CertificateExpires = warning("certificate-expires").raises("certificate {file} of bus {bus}").hint(RENEW);
    /// A certificate of an OPC UA bus has expired.
    CertificateExpired = error("certificate-expired").raises("certificate {file} of bus {bus}").hint(RENEW);
    /// A certificate of an OPC UA bus or of the OPC UA server is not valid yet.
    CertificateNotYetValid = warning("certificate-not-yet-valid")
        .hint("correct the clock of this computer, or wait until the certificate is valid");
    /// A task of the gateway failed. The axes that depend on the task run their fault action.
    TaskFailed = error("task-failed").raises("task {task}")
        .hint("keep the log of this hour and report the failure; restart the gateway if it does not restart by itself");
    /// The settings of a device differ from those that the profile expects. No axis that needs the device is armed.
    NotAsExpected = error("not-as-expected").raises("settings of device {device}")
        .hint("change the setting at the device, or correct the profile; until then, no axis that needs the device is \
               armed");
    /// The settings of a device are again those that the profile expects.
    AsExpected = info("as-expected").ends(&["settings of device {device}"]);
    /// A CAN node reports an emergency.
    Emergency = warning("emergency").raises("emergency of device {device}")
        .hint("look up the emergency code in the manual of the device");
    /// An emergency has ended.
    EmergencyOver = info("emergency-over").ends(&["emergency of device {device}"]);
    /// A CAN node was reset, or has stopped for another reason. The gateway configures and starts the node again.
    NodeReset = warning("node-reset")
        .hint("if the operator did not cause this, check the power supply and the plug of the node");
    /// The interlock of an output is open. The gateway does not write the output.
    Interlocked = info("interlocked");
    /// The interlock of an output is closed again. The gateway may write the output.
    Released = info("released");
    /// The address, scale or owner of an output's register differs from the last run. The axis of the output is off.
    OutputMoved = error("output-moved").raises("place of output {output}")
        .hint("compare the profile with the control, then arm the axis");
    /// A register that no longer belongs to any output contains a verified value of the gateway.
    RegisterLeft = warning("register-left").raises("former register of output {output}")
        .hint("release the register, or correct its value at the control");
    /// A register that belonged to no output was returned to its base value at the operator's request, and verified.
    RegisterReleased = info("register-released").ends(&["former register of output {output}"]);
    /// The operator has armed the axis of an output, and so confirmed the changed or former register of the output.
    PlaceConfirmed = info("place-confirmed")
        .ends(&["place of output {output}", "former register of output {output}"]);
    /// The address of a signal differs from the last run. The references of the signal are captured again.
    ReferenceForgotten = warning("reference-forgotten").hint("measure a part");
    /// The gateway has stored the URI of a namespace that the profile names by index.
    NamespaceRecorded = info("namespace-recorded");
    /// A namespace has another index on the server than in the profile. The gateway uses the server's index.
    NamespaceMoved = warning("namespace-moved").hint("write nsu={uri};... instead of ns={from};... in the profile");
    /// The Cz in a corrected position (measured position plus Cz) is not known from an earlier run. Cz starts at zero.
    PositionFromZero = warning("position-from-zero")
        .hint("compare the position at the display with the scale before a part is made");
    /// The gateway cannot tell which part of a shared register's value it has added (gateway share). The operator must
    /// confirm the share.
    LedgerDoubt = error("ledger-doubt").raises("ledger of {output}")
        .hint("set the register to the operator offset plus the gateway share that the event names, then arm \
               the axis");
    /// A register to be shared has an unknown value that is not zero. The operator must confirm that the value is an
    /// operator offset.
    FirstAccount = warning("first-account").raises("ledger of {output}")
        .hint("if the whole value is the operator offset, arm the axis; if not, first set the register to \
               the operator offset");
    /// The gateway has recorded the two parts of the value in a shared register: operator offset and gateway share.
    LedgerOpened = info("ledger-opened").ends(&["ledger of {output}"]);
    /// The operator has changed the operator offset in a shared register.
    OperatorChange = info("operator-change");
    /// A write of the gateway arrived long after it was sent.
    OwnWriteLate = warning("own-write-late").hint(LOSES_ANSWERS);
    /// An unexpected register value appeared after a start of the gateway. It may come from a write that the gateway
    /// sent before the start.
    PerhapsFromBefore = warning("perhaps-from-before")
        .hint("if the gateway did not write the value, disarm the axis and correct the value at the control");
    /// The gateway delays the next change of a register. An earlier write may still arrive, and the change would be too
    /// far from the value of that write.
    WaitsForLateWrite = warning("waits-for-late-write").hint(LOSES_ANSWERS);
    /// The previous run was not stopped normally, or its end is unknown. One of its writes may still arrive. Therefore
    /// the gateway only reads the register at first.
    WaitsAfterStart = info("waits-after-start");
    /// Writes to a register are acknowledged, but the register cannot be read.
    NotReadBack = info("not-read-back").word(UNVERIFIED);
    /// The acknowledge signal of the control was set before the gateway set the strobe signal, and stayed set.
    AcknowledgeEarly = error("acknowledge-early").hint(DROPS_ACKNOWLEDGE);
    /// The control did not acknowledge the strobe signal in time.
    AcknowledgeMissing = error("acknowledge-missing")
        .hint("check that the control's program runs and reads this strobe signal. If it does, raise `timeout` of \
               the handshake");
    /// The acknowledge signal of the control could not be read.
    AcknowledgeNotRead = error("acknowledge-not-read").hint(MAY_ACCESS);
    /// The acknowledge signal of the control stayed set after the gateway had reset the strobe signal.
    AcknowledgeStuck = error("acknowledge-stuck").hint(DROPS_ACKNOWLEDGE);
    /// The gateway could not set the strobe signal of a handshake.
    StrobeNotWritten = error("strobe-not-written").hint(MAY_ACCESS);
    /// The gateway could not reset the strobe signal of a handshake.
    StrobeNotDropped = error("strobe-not-dropped").hint(MAY_ACCESS);
    /// The axis has corrected its model with a measured error.
    Probed = info("probed");
    /// A measured error was refused. The axis does not correct its model with this error.
    ProbeRefused = warning("probe-refused").hint("measure again");
    /// The correction of an axis's models from measured errors was discarded.
    ProbeForgotten = info("probe-forgotten");
    /// The operator has reported in which direction a gauge moved when Cz increased. Every direction other than plus is
    /// trouble.
    SignChecked = error("sign-checked").or_info()
        .hint("disarm the axis, change the sign of `scale` at its output, and check the sign again");
    /// A sign check has ended without an answer of the operator. Cz returns to its value without the check.
    SignEnded = warning("sign-ended").hint("check the sign again");
    /// The position counter of a signal was set, referenced or restarted. The axis did not move.
    Rereferenced = warning("rereferenced")
        .hint("if the operator has not referenced the axis, check the encoder and its power supply");
    /// The device of a signal has changed the scale of the value, which the gateway reads from another register. The
    /// signal is bad until its value is plausible with the new scale.
    ScaleChanged = warning("scale-changed")
        .hint("if nobody changed the resolution or the decimal point of the device, check `scale_from` or \
               `decimals_from`, and the device");
    /// The machine was started. Its running time is counted from this moment.
    MachineStarted = info("machine-started");
    /// The gateway captures the "zero" references of the signals from now on.
    Zeroed = info("zeroed");
    /// A bus has more exchanges than it can carry: an exchange was late. The event is reported again only after the bus
    /// was fast enough in between.
    Overrun = warning("overrun")
        .hint("use a longer `every`, fewer registers or a faster line; `isotherm check` shows the load of \
               each bus");
    /// A device does not support two requests at a time. The gateway now sends requests to the device one by one.
    PipelineGivenUp = warning("pipeline-given-up").hint("remove `pipeline` from the profile");
    /// The Modbus gateway of a bus waits for a silent device for longer than `timeout`. Meanwhile it forwards no
    /// request to another device. isotherm asks silent devices so seldom that the readings of the other devices do not
    /// become too old.
    GatewayTimeout = warning("gateway-timeout")
        .hint("set a shorter timeout in the Modbus gateway, write a longer `timeout` of the bus, or remove units that \
               do not exist from the profile");
    /// A server does not support a requested subscription, or supports it only with other settings.
    Subscription = warning("subscription")
        .hint("set the server to send values as often as `every` demands, or write a longer `every`");
    /// The gateway did not run for some time: the computer was stopped, suspended or overloaded.
    StoodStill = warning("stood-still")
        .hint("check whether another program overloads the computer, and switch automatic suspend off. Use a \
               dedicated computer for the gateway");
    /// The gateway has started.
    Started = info("started");
    /// The gateway was asked to stop. It runs the fault actions, or keeps the register values.
    Stopping = info("stopping");
    /// The gateway has stopped. The event lists the values that stay in the registers.
    Stopped = info("stopped");
    /// A device template of the profile differs from the template that the last run used.
    TemplateChanged = warning("template-changed")
        .hint("check the settings that `isotherm check` prints, before the machine makes parts");
    /// Some temperatures have default limits that the last run did not apply. The gateway rejects readings beyond these
    /// limits, because the profile and its template state no limits. Each limit is reported once.
    DefaultLimits = warning("default-limits")
        .hint("write `range` and `max_rate` for each sensor, or \"none\"; for a difference of temperatures, write \
               `difference = true`");
    /// Other gateways on this computer cannot be detected. A second gateway that writes the same register would not be
    /// rejected.
    NotExclusive = warning("not-exclusive").hint("make sure that only one gateway writes to each register");
    /// The state or the log could not be saved on disk.
    NotKept = warning("not-kept").raises("keeping {what}")
        .hint("free disk space for the state directory, or use another state directory (`--state`)");
    /// The state or the log can be saved on disk again.
    KeptAgain = info("kept-again").ends(&["keeping {what}"]);
    /// The saved state, or the register ledger in it, was rejected: it is damaged, was changed, or is a copy from
    /// elsewhere.
    NotBelieved = error("not-believed").raises("belief in state and ledger")
        .hint("compare the registers of the control with their correct values, then arm the axes");
    /// The gateway was restarted in the same process, and rejected the state that the former program handed over.
    HandoverRefused = warning("handover-refused").hint("arm the axes that are off");
    /// The gateway runs the checked profile, but some of its files, variables or settings have changed since the check.
    ProfileDiffers = warning("profile-differs")
        .hint("to use the changed files: `isotherm restart {profile} --keep`");
    /// The saved state, or the saved register ledger, comes from an earlier version of the program, and is used.
    TakenFromEarlier = warning("taken-from-earlier");
    /// Some events are missing on disk, because the disk did not save them in time.
    EventsLost = warning("events-lost").hint("check whether the disk is full, slow or broken");
    /// The file of a day's events is full. Further events of the day are not saved.
    EventsFull = warning("events-full").hint("`isotherm events` shows which events are so frequent");
    /// Logs were deleted.
    LogsDeleted = info("logs-deleted");
    /// The web page cannot listen at its address.
    PageClosed = warning("page-closed").raises("page at {listen}")
        .hint("free the address, or set another address; the gateway tries again every ten seconds, and the compensation \
               continues");
    /// The web page listens at its address now.
    PageOpen = info("page-open").ends(&["page at {listen}"]);
    /// A token file of the web page contains another token.
    TokenChanged = info("token-changed");
    /// A token file of the web page contains no valid token.
    TokenGone = error("token-gone").hint("`isotherm token --out FILE` makes a token file that only its owner can read");
    /// A message to a server of `[[notify]]` could not be delivered. Further failures are not reported until a message
    /// arrives.
    NotifyFailed = warning("notify-failed").raises("messages of {notify}")
        .hint("check that the server runs, and that `url` and token are right. The gateway tries a few times more, and \
               the compensation continues");
    /// A message to a server of `[[notify]]` has arrived after failures.
    NotifyBack = info("notify-back").ends(&["messages of {notify}"]);
    /// Messages to a server of `[[notify]]` were given up after failures, or the queue had no room for them.
    NotifyDropped = warning("notify-dropped").hint(SEE_EVENTS);
    /// The connection to the broker of `[mqtt]` is lost.
    BrokerDown = warning("broker-down").raises("broker {broker}")
        .hint("check that the broker runs, and that its address, user and certificate are those of `[mqtt]`. The \
               gateway tries again, and the compensation continues");
    /// The connection to the broker of `[mqtt]` is back.
    BrokerUp = info("broker-up").ends(&["broker {broker}"]);
    /// Messages to the broker were dropped, because it was not reachable or too slow.
    BrokerDropped = warning("broker-dropped").hint(SEE_EVENTS);
    /// Messages that the broker missed could not be saved on disk for later delivery.
    BrokerNotKept = warning("broker-not-kept")
        .hint("free space in the state directory, and allow the gateway to write to it");
    /// The broker of `[mqtt]` does not let the gateway subscribe to a topic. No message of this topic arrives.
    BrokerSubscriptionRefused = warning("broker-subscription-refused").raises("subscription to {topic} at {broker}")
        .hint("allow the user of `[mqtt]` to subscribe to this topic at the broker");
    /// The broker of `[mqtt]` accepts a subscription that it had refused.
    BrokerSubscribed = info("broker-subscribed").ends(&["subscription to {topic} at {broker}"]);
    /// The broker of `[mqtt]` closed the connection three times after a message to this topic. The gateway publishes
    /// nothing to this topic until it is restarted.
    BrokerPublishDenied = warning("broker-publish-denied").raises("publishing to {topic} at {broker}")
        .hint("allow the user of `[mqtt]` to publish to this topic at the broker, then restart the gateway: \
               `isotherm restart PROFILE --keep`");
    /// The primary host of `[mqtt]` is offline. The gateway stores values and events on disk, and publishes nothing.
    HostOffline = warning("host-offline").raises("primary host {host}")
        .hint("check that the host application runs, and that `primary_host` is its host ID. The compensation \
               continues");
    /// The primary host of `[mqtt]` is online again. The gateway publishes what it has stored.
    HostOnline = info("host-online").ends(&["primary host {host}"]);
    /// The OPC UA server of `[opcua_server]` cannot listen at its address, or has failed.
    OpcUaServerClosed = warning("opcua-server-closed").raises("OPC UA server at {listen}")
        .hint("free the address, or set another address; the gateway tries again every ten seconds, and the compensation \
               continues");
    /// The OPC UA server of `[opcua_server]` listens at its address now.
    OpcUaServerOpen = info("opcua-server-open").ends(&["OPC UA server at {listen}"]);
    /// The OPC UA server of `[opcua_server]` has refused a client, because its certificate is not trusted.
    OpcUaClientRefused = warning("opcua-client-refused")
        .hint("if this client may log in, copy its certificate into the directory `trusted` of `[opcua_server]`, and \
               run `isotherm restart PROFILE --keep`");
    /// A command was carried out.
    Command = info("command");
    /// A command was refused.
    CommandRefused = warning("command-refused");
    /// A command was dropped, because its sender no longer waited for the result. The gateway does not carry out the
    /// command.
    CommandDropped = warning("command-dropped").hint("give the command again");
}

impl EventKind {
    const fn entry(self) -> &'static Entry {
        &ENTRIES[self as usize]
    }

    /// Returns the name of the kind for programs: one word, also the label of the counter.
    pub const fn name(self) -> &'static str {
        self.entry().name
    }

    /// Returns the severity of events of this kind. If [`EventKind::may_be_info`] is true, this is the severity of the
    /// events that report trouble.
    pub const fn level(self) -> Level {
        self.entry().level
    }

    /// Returns whether events of this kind may report no trouble. Events without trouble have the level
    /// [`Level::Info`].
    pub const fn may_be_info(self) -> bool {
        self.entry().may_be_info
    }

    /// Returns the name of the alarm that an event of this kind raises, unless the event has the level [`Level::Info`].
    /// `{axis}` stands for a field of the event's data. `None` if there is no alarm.
    pub const fn raises(self) -> Option<&'static str> {
        self.entry().raises
    }

    /// Returns the names of the alarms that an event of this kind ends, unless the event raises an alarm itself.
    pub const fn ends(self) -> &'static [&'static str] {
        self.entry().ends
    }

    /// Returns the kinds that end the alarm of this kind.
    pub fn ended_by(self) -> impl Iterator<Item = EventKind> {
        let raised = self.raises();
        EventKind::ALL
            .into_iter()
            .filter(move |kind| raised.is_some_and(|alarm| kind.ends().contains(&alarm)))
    }

    /// Returns the word of `[[notify]]` that selects several kinds, including this one; `None` if there is no such
    /// word.
    pub const fn word(self) -> Option<&'static str> {
        self.entry().word
    }

    /// Returns the hint for an event whose cause has no hint of its own. `{axis}` stands for a field of the event's
    /// data.
    pub const fn hint(self) -> Option<&'static str> {
        self.entry().hint
    }

    /// Returns the meaning of the kind for the operator, in one or more sentences.
    pub const fn meaning(self) -> &'static str {
        self.entry().meaning.trim_ascii()
    }
}

#[cfg(test)]
mod tests;
