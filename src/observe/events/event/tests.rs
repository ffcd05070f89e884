use super::*;

/// Every event with a count, each with the count one.
fn of_one() -> Vec<Event> {
    let text = String::new;
    vec![
        Event::Started { machine: text(), bus_requests: 1 },
        Event::LinkUp { bus: text(), address: text(), attempts: 1 },
        Event::DeviceBack { device: text(), at: text(), missed: 1 },
        Event::Verified { output: text(), failures: 1 },
        Event::EmergencyOver { device: text(), count: 1 },
        Event::EventsLost { count: 1 },
        Event::Broker(Broker::Up { broker: text(), attempts: 1 }),
        Event::Broker(Broker::Dropped { broker: text(), count: 1 }),
        Event::Delivery(Delivery::Back { notify: text(), to: text(), attempts: 1 }),
        Event::Delivery(Delivery::Dropped { notify: text(), to: text(), count: 1 }),
    ]
}

#[test]
fn one_of_something_has_no_plural() {
    for event in of_one() {
        let (kind, text) = (event.described().kind, event.described().text());
        let (_, after) = text.split_once("1 ").unwrap_or_else(|| panic!("{kind:?}: {text}"));
        let noun = after.split([' ', ';', ':', ',']).find(|word| !matches!(*word, "read" | "wrong"));
        assert!(noun.is_some_and(|noun| !noun.ends_with('s')), "{kind:?}: {text}");
    }
}

#[test]
fn days_stand_apart_from_their_number() {
    let event = Event::SignalGood { signal: "bed".into(), bad_for: Duration::from_secs(9 * 86_400 + 60) };
    assert_eq!(event.described().text(), "signal bed: good again after 9 days 1m");
}
