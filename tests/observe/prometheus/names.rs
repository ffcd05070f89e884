//! Names of the metrics, checked by promtool and against the manual.

use std::collections::BTreeSet;

use crate::prometheus::fake::{self, Door};
use crate::prometheus::server::{chapter, promtool};
use isotherm::observe::status::BrokerStatus;

/// Metrics of a gateway with all values.
async fn everything() -> String {
    let door = Door::open(None).await;
    door.change(|status| {
        let axis = &mut status.axes[0];
        (axis.raw_um, axis.error_um) = (Some(13.0), Some(50.0));
        status.mqtt = Some(BrokerStatus::default());
        (status.outputs[0].waits_s, status.lock_held) = (Some(3.0), vec![(1e-6, 5), (f64::INFINITY, 1)]);
    });
    door.get("/metrics").await.body
}

#[tokio::test]
async fn promtool_has_nothing_to_say_of_their_names_and_the_manual_names_each() {
    let text = everything().await;
    let (code, said) = promtool(&["check", "metrics"], &text);
    assert_eq!((code, said.as_str()), (0, ""), "{text}");

    fake::exposition(&text);
    let families: BTreeSet<&str> =
        text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()).collect();
    let chapter = chapter();
    let table = chapter.split("## Every metric").nth(1).unwrap();
    let rows = table.lines().filter_map(|line| line.strip_prefix("| `")?.split(" |").next());
    let listed: BTreeSet<&str> =
        rows.flat_map(|names| names.split('`')).filter(|name| name.starts_with("isotherm_")).collect();
    assert_eq!(families, listed);
}
