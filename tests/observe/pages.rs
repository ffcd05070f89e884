//! Pages of the state of a machine with many devices.

use isotherm::observe::events::{Acknowledgement, Alarm, Level};
use isotherm::observe::status::Status;
use serde_json::{Value, json};

use crate::support::fake::Door;

/// Returns the first state in a stream.
async fn first(door: &Door, path: &str) -> Value {
    let event = door.stream(path).await.until("\n\n").await;
    let data = event.lines().find_map(|line| line.strip_prefix("data: ")).unwrap();
    serde_json::from_str(data).unwrap()
}

fn copies<T: Clone>(of: &T, count: usize, rename: impl Fn(&mut T, usize)) -> Vec<T> {
    let mut copies = vec![of.clone(); count];
    copies.iter_mut().enumerate().for_each(|(number, copy)| rename(copy, number));
    copies
}

pub(crate) fn alarm(id: &str, level: Level, since: &str) -> Alarm {
    Alarm {
        id: id.into(),
        kind: "signal-bad".into(),
        level,
        since: since.into(),
        text: format!("{id}: open circuit: check the sensor"),
        cause: None,
        hint: Some("check the sensor".into()),
        acknowledged: None,
    }
}

/// Gives the machine 120 devices on 60 buses. Each has one signal, and one axis with its output.
pub(crate) fn with_120_devices(status: &mut Status) {
    status.axes = copies(&status.axes[0], 120, |axis, number| axis.name = format!("z{number}"));
    status.signals = copies(&status.signals[1], 120, |signal, number| {
        signal.name = format!("t{number}");
        signal.device = format!("rtd{number}");
    });
    status.buses = copies(&status.buses[0], 60, |bus, number| bus.name = format!("cell{number}"));
    status.devices = copies(&status.devices[0], 120, |device, number| {
        device.name = format!("rtd{number}");
        device.bus = format!("cell{}", number / 2);
    });
    status.outputs = copies(&status.outputs[0], 120, |output, number| {
        output.name = format!("z{number}_offset");
        output.axis = format!("z{number}");
        output.device = format!("rtd{number}");
    });
}

#[tokio::test]
async fn the_only_page_of_a_small_machine_is_its_state() {
    let door = Door::open(None).await;
    let mut page = first(&door, "/api/live?page=1").await;
    assert_eq!(page.as_object_mut().unwrap().remove("page"), Some(json!({ "number": 1, "of": 1 })));
    assert_eq!(page, first(&door, "/api/live").await);
}

#[tokio::test]
async fn a_page_has_fifty_devices_with_all_that_belongs_to_them_and_facts_about_the_machine() {
    let door = Door::open(None).await;
    door.change(with_120_devices);
    let names = |part: &Value, list: &str| -> Vec<String> {
        let all = part[list].as_array().unwrap().iter();
        all.map(|one| one["name"].as_str().unwrap().to_owned()).collect()
    };
    let numbered = |name: &str, numbers: std::ops::Range<usize>| -> Vec<String> {
        numbers.map(|number| format!("{name}{number}")).collect()
    };
    for (asked, number, devices) in [(1, 1, 0..50), (2, 2, 50..100), (3, 3, 100..120), (9, 3, 100..120)] {
        let page = first(&door, &format!("/api/live?page={asked}")).await;
        assert_eq!(page["page"], json!({ "number": number, "of": 3 }));
        assert_eq!(names(&page, "devices"), numbered("rtd", devices.clone()));
        assert_eq!(names(&page, "signals"), numbered("t", devices.clone()));
        assert_eq!(names(&page, "axes"), numbered("z", devices.clone()));
        assert_eq!(names(&page, "buses"), numbered("cell", devices.start / 2..devices.end / 2));
        assert_eq!(page["outputs"].as_array().unwrap().len(), devices.len());
        assert_eq!(names(&page["whole"], "axes"), numbered("z", 0..5));
        assert_eq!((&page["whole"]["lost"], &page["whole"]["bad"]), (&json!(120), &json!(0)));
    }
    let whole = first(&door, "/api/live").await;
    assert_eq!((names(&whole, "devices").len(), whole.get("page"), whole.get("whole")), (120, None, None));
}

/// Checks that axes in a rare state, and an output with a value of another program, are on every page.
#[tokio::test]
async fn every_page_has_the_axes_that_speak_for_the_machine() {
    let door = Door::open(None).await;
    door.change(|status| {
        with_120_devices(status);
        status.axes[110].arming.armed = false;
        status.outputs[115].state = "foreign";
        // An axis without an output is on the first page.
        status.outputs.remove(70);
    });
    let page = first(&door, "/api/live?page=1").await;
    assert_eq!(
        (&page["whole"]["axes"][5]["name"], &page["axes"][50]["name"]),
        (&json!("z110"), &json!("z70"))
    );
    assert_eq!(page["whole"]["outputs"][0]["name"], "z115_offset");
}

#[tokio::test]
async fn a_page_has_the_most_urgent_alarms_and_the_pages_of_their_subjects() {
    let door = Door::open(None).await;
    let since = "2026-07-02T11:55:00Z";
    door.change(|status| {
        with_120_devices(status);
        let devices = (0..120).map(|number| format!("device rtd{number}"));
        status.alarms = devices.map(|id| alarm(&id, Level::Warning, since)).collect();
        let seen = Acknowledgement { at: since.to_owned(), by: "an operator".to_owned() };
        status.alarms[0].acknowledged = Some(seen);
        for id in ["arming of axis z110", "sensor of axis z0: t105", "bus cell59", "broker plant"] {
            status.alarms.push(alarm(id, Level::Error, since));
        }
    });
    let page = first(&door, "/api/live?page=2").await;
    let ids: Vec<&str> =
        page["alarms"].as_array().unwrap().iter().map(|alarm| alarm["id"].as_str().unwrap()).collect();
    assert_eq!((ids.len(), &page["whole"]["alarm_count"]), (100, &json!(124)));
    assert_eq!((ids[0], ids[4], ids[99]), ("arming of axis z110", "device rtd1", "device rtd96"));
    let pages = &page["whole"]["alarm_pages"];
    for (id, number) in [
        ("arming of axis z110", Some(3)),
        ("sensor of axis z0: t105", Some(3)),
        ("bus cell59", Some(3)),
        ("broker plant", None),
        ("device rtd1", Some(1)),
        ("device rtd60", None),
    ] {
        assert_eq!(pages.get(id), number.map(|number| json!(number)).as_ref(), "{id}");
    }
}

#[tokio::test]
async fn a_page_without_a_number_is_refused_in_words() {
    let door = Door::open(None).await;
    for number in ["0", "-1", "x", ""] {
        let refused = door.get(&format!("/api/live?page={number}")).await;
        assert_eq!((refused.code, refused.body.as_str()), (400, "page: write a number from 1\n"), "{number}");
    }
}
