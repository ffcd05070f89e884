use super::super::test_profiles::{THREE_SIGNALS, bench};
use super::*;
use crate::fieldbus::error::{CanFault, LinkFault};
use crate::observe::status::DeviceStatus;
use std::path::Path;

#[test]
fn neither_an_old_answer_nor_an_old_failure_changes_the_state_of_a_can_interface() {
    const PROFILE: &str = r#"
        [machine]
        name = "can"
        [bus.can]
        type = "can"
        interface = "can0"
        [device.cnc]
        bus = "can"
        node = 9
    "#;
    let profile = isotherm_profile::parse(Path::new("can.toml"), PROFILE, &[], &[]).unwrap().profile;
    let (mut device_health, mut events) = (DeviceHealth::new(&Arc::new(profile)), Vec::new());
    let down = Fault::Link(LinkFault::Can(CanFault::Down));
    let (bus, cnc) = (BusId(0), DeviceId(0));
    device_health.link_is_down(bus, 1, down, &mut events);
    device_health.fails(cnc, down, (3, down), &mut events);
    device_health.answers(cnc, Moment::from_nanos(1), &mut events);
    assert!(matches!(events[..], [Event::LinkDown { .. }]), "{events:?}");
    device_health.link_is_up(bus, &mut events);
    device_health.fails(cnc, down, (3, down), &mut events);
    assert!(matches!(events[1..], [Event::LinkUp { attempts: 1, .. }]), "{events:?}");
    device_health.link_is_down(bus, 1, down, &mut events);
    assert!(matches!(events[2..], [Event::LinkDown { .. }]), "{events:?}");
}

/// Checks that messages about signals name the key that helps: refusals and silence of a read over a gap.
#[test]
fn the_fault_of_a_read_of_several_signals_names_the_key_that_helps() {
    let profile = bench(THREE_SIGNALS);
    let of = |name: &str| SignalId(profile.signals.iter().position(|one| one.name == name).unwrap());
    let (bed, oil, module) = (of("bed"), of("oil"), DeviceId(0));
    let requests = profile.requests(module);
    let read = |function: u8| {
        let mut requests = requests.iter().filter_map(|request| Request::in_registers(&request.asks));
        requests.find(|request| request.function() == function).unwrap()
    };
    let (over_gap, single) = (read(4), read(3));
    let profile = Arc::new(profile);
    let (mut health, mut events) = (DeviceHealth::new(&profile), Vec::new());
    let never = (0, Fault::Link(LinkFault::Down));

    let refused = Fault::Exception(2);
    health.record(module, over_gap, Err(refused));
    let said = health.why(bed, refused.reason()).to_string();
    assert!(said.contains("the device has no such register") && said.contains("max_gap = 0"), "{said}");
    let said = health.why(oil, refused.reason()).to_string();
    assert!(said.contains("one-based") && !said.contains("max_gap"), "{said}");

    // At first it is not known whether the device is dead.
    let silent = health.record(module, over_gap, Err(Fault::Timeout)).unwrap();
    health.fails(module, silent, never, &mut events);
    let said = health.why(bed, Reason::Timeout).to_string();
    assert!(said.contains("is the unit number right") && said.contains("`max_registers_per_request`"));
    // The device answers another request.
    health.record(module, single, Ok(()));
    health.answers(module, Moment::from_nanos(1), &mut events);
    let said = health.why(bed, Reason::Timeout).to_string();
    assert!(said.contains("answers other requests") && !said.contains("unit number"), "{said}");
    let silent = health.record(module, over_gap, Err(Fault::Timeout)).unwrap();
    health.fails(module, silent, never, &mut events);
    let again = health.why(bed, Reason::Timeout).to_string();
    assert_eq!(again, said);
}

/// The profile has no `range` and no `max_rate` that an operator could find. The message states the limit.
#[test]
fn a_reading_beyond_a_default_limit_is_explained_by_that_limit() {
    const RISE: &str = r#"
        [signal.rise]
        device = "module"
        register = "input:0"
        type = "i16"
        unit = "K"
        max_age = "5s"
        LIMITS
        [axis.z]
        limit = 40.0
        step = 1.0
        rate = 0.5
        every = "10s"
        on_fault = { action = "hold" }
        [[axis.z.model]]
        name = "one"
        kind = "linear"
        terms = [{ signal = "rise", gain = 1.0, reference = 0.0 }]
    "#;
    let said = |limits: &str, reason: Reason| {
        let profile = bench(&RISE.replace("LIMITS", limits));
        DeviceHealth::new(&Arc::new(profile)).why(SignalId(0), reason).to_string()
    };
    let text = said("", Reason::OutOfRange);
    assert!(text.starts_with("out of range (outside 233.15 to 473.15 K, the default limit):"), "{text}");
    assert!(text.contains("`difference = true`"), "{text}");
    let text = said("", Reason::TooFast);
    let words = "changing too fast (faster than 5 K per second, the default limit):";
    assert!(text.starts_with(words), "{text}");
    assert!(text.contains("write a larger `max_rate`"), "{text}");
    let stated = "range = [250.0, 350.0]\nmax_rate = 2.0";
    assert!(said(stated, Reason::OutOfRange).contains("are `range`, `scale` or `word_order` wrong"));
    assert!(said(stated, Reason::TooFast).contains("`max_rate` is too small"));
}

#[test]
fn another_cause_is_reported_once_it_was_found_twice() {
    let profile = include_str!("../../../../profiles/surface-grinder.toml");
    let profile = isotherm_profile::parse(Path::new("grinder.toml"), profile, &[], &[]).unwrap().profile;
    let (mut device_health, mut events) = (DeviceHealth::new(&Arc::new(profile)), Vec::new());
    for (attempt, fault) in
        [LinkFault::Refused, LinkFault::Refused, LinkFault::Unreachable, LinkFault::Unreachable]
            .into_iter()
            .enumerate()
    {
        device_health.link_is_down(BusId(0), attempt as u64, Fault::Link(fault), &mut events);
    }
    assert_eq!(events.len(), 2, "{events:?}");
    device_health.link_is_up(BusId(0), &mut events);
    assert!(matches!(events[..], [_, _, Event::LinkUp { attempts: 3, .. }]), "{events:?}");
}

#[test]
fn whoever_can_be_to_blame_has_a_counter_from_the_start() {
    assert_eq!(DeviceStatus::BLAMES, Fault::BLAMES);
}

#[test]
fn a_late_cycle_is_reported_if_it_is_late_enough_and_no_device_is_silent() {
    let (mut device_health, mut events) = (DeviceHealth::new(&Arc::new(bench(""))), Vec::new());
    let (bus, module, now) = (BusId(0), DeviceId(0), Moment::from_nanos(1));
    let (short, long, second) = (Duration::from_millis(9), Duration::from_millis(10), Duration::from_secs(1));
    assert!(!device_health.overrun(bus, (1, short), now));
    device_health.fails(module, Fault::Timeout, (0, Fault::Timeout), &mut events);
    assert!(!device_health.overrun(bus, (1, second), now), "the line waits for the device");
    device_health.answers(module, now, &mut events);
    assert!(device_health.overrun(bus, (2, long), now));
    assert!(!device_health.overrun(bus, (1, second), now), "it was a moment ago");
    let later = now.after(REPORTED_AGAIN + second);
    assert!(device_health.overrun(bus, (1, second), later));
    assert_eq!(device_health.buses[0].overruns, 6);
}
