//! HTML and files of the page, as the server sends them to a browser.

use std::collections::BTreeSet;

use crate::http::OPERATOR;
use crate::support::fake::Door;

/// A proxy may serve the page below a path of its own.
#[tokio::test]
async fn no_address_of_the_page_begins_at_the_root_of_the_server() {
    let door = Door::open(None).await;
    let closed = Door::open(Some(OPERATOR)).await;
    let login = closed.send("GET", "/", &[("Accept", "text/html")], "").await;
    let pages = [door.get("/").await.body, door.get("/?view=wall").await.body, login.body];
    for page in &pages {
        for start in ["href=\"/", "src=\"/", "action=\"/"] {
            assert!(!page.contains(start), "{start} in {page}");
        }
    }
    let scripts = pages.iter().flat_map(|page| page.split('"')).filter(|text| text.ends_with(".js"));
    let scripts = scripts.collect::<BTreeSet<_>>();
    assert!(scripts.len() > 20, "{scripts:?}");
    for script in scripts {
        let text = door.get(&format!("/{script}")).await.body;
        for start in ["fetch(\"/", "fetch(`/", "EventSource(\"/", "href = `/", "from \"/"] {
            assert!(!text.contains(start), "{start} in {script}");
        }
    }
}

#[tokio::test]
async fn the_icon_has_the_number_of_alarms() {
    let door = Door::open(None).await;
    for (file, count) in
        [("icon-1.svg", ">1</text>"), ("icon-8.svg", ">8</text>"), ("icon-9.svg", ">9+</text>")]
    {
        let icon = door.get(&format!("/page/{file}")).await;
        assert_eq!((icon.code, icon.header("content-type")), (200, "image/svg+xml"), "{file}");
        assert!(icon.body.contains(count), "{}", icon.body);
    }
    assert_eq!(door.get("/page/icon-10.svg").await.code, 404);
}

#[tokio::test]
async fn the_sign_in_page_names_the_machine_and_shows_nothing_else_of_it() {
    let door = Door::open(Some(OPERATOR)).await;
    let page = door.send("GET", "/", &[("Accept", "text/html")], "").await;
    assert_eq!(page.code, 401);
    assert!(page.body.contains("<h1>研削盤 &quot;3&quot;</h1>"), "{}", page.body);
    for other in ["t1", "z_offset", "192.0.2.9", "west", "12.5"] {
        assert!(!page.body.contains(other), "{other} in {}", page.body);
    }
}
