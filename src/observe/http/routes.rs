//! Routes of the server: each path with its methods. The router, the access check and the description of the API are
//! made from this list.

use std::sync::LazyLock;

use axum::http::{Method, StatusCode, header};
use axum::response::{IntoResponse, Response};

use crate::observe::status::Command;

/// Use of a route of the server, which determines its handlers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Route {
    /// Web page: the front page, or the wall view, which is a page for a large screen on a wall.
    Front,
    /// File that the web page loads, for example a script.
    File,
    /// Sign-in with a browser: the form, and the token that the form sends.
    Login,
    /// Sign-out, which ends the session of a browser.
    Logout,
    /// Command to the gateway, for example to arm the axes.
    Command(Command),
    /// Acknowledgement of one alarm, or of all active alarms.
    Acknowledge,
    /// Measured error of an axis: sends an error, or removes the correction from earlier errors.
    Measured,
    /// Status of the gateway as JSON.
    Status,
    /// Live stream of the status, with one message each second.
    Live,
    /// Events of a time range as JSON.
    Events,
    /// Values from the decision logs as JSON, for a chart.
    History,
    /// Rows of the decision logs as CSV, for a download.
    Download,
    /// Description of the API for programs, in the format OpenAPI.
    OpenApi,
    /// Metrics in the format of Prometheus.
    Metrics,
    /// Health check: the answer shows that the process runs.
    Healthy,
    /// Readiness check: whether the gateway compensates as intended.
    Ready,
}

/// All routes except the routes of commands, with their paths and methods. A name in braces matches any path
/// segment.
const FIXED: [(Route, &str, &[&str]); 15] = [
    (Route::Front, "/", &["GET"]),
    (Route::File, "/page/{file}", &["GET"]),
    (Route::Login, "/login", &["GET", "POST"]),
    (Route::Logout, "/api/logout", &["POST"]),
    (Route::Acknowledge, "/api/acknowledge", &["POST"]),
    (Route::Measured, "/api/axes/{axis}/measured", &["POST", "DELETE"]),
    (Route::Status, "/api/status", &["GET"]),
    (Route::Live, "/api/live", &["GET"]),
    (Route::Events, "/api/events", &["GET"]),
    (Route::History, "/api/history", &["GET"]),
    (Route::Download, "/api/history.csv", &["GET"]),
    (Route::OpenApi, "/openapi.json", &["GET"]),
    (Route::Metrics, "/metrics", &["GET"]),
    (Route::Healthy, "/healthz", &["GET"]),
    (Route::Ready, "/readyz", &["GET"]),
];

/// Route with its path and its methods.
pub(super) struct Entry {
    pub(super) route: Route,
    /// Path of the route. A name in braces matches any path segment.
    pub(super) path: String,
    /// Methods of the handlers. A route with GET accepts HEAD too.
    pub(super) methods: &'static [&'static str],
}

static ROUTES: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let command = |(name, command): (&str, Command)| Entry {
        route: Route::Command(command),
        path: format!("/api/{name}"),
        methods: &["POST"],
    };
    let fixed = |(route, path, methods): (Route, &str, &'static [&'static str])| Entry {
        route,
        path: path.to_owned(),
        methods,
    };
    FIXED.into_iter().map(fixed).chain(Command::ALL.into_iter().map(command)).collect()
});

/// Returns all routes.
pub(super) fn all() -> &'static [Entry] {
    &ROUTES
}

/// Returns the route of a path; `None` if the server has no such path.
pub(super) fn at(path: &str) -> Option<&'static Entry> {
    ROUTES.iter().find(|entry| matches(&entry.path, path))
}

fn matches(pattern: &str, path: &str) -> bool {
    let (mut pattern, mut path) = (pattern.split('/'), path.split('/'));
    loop {
        match (pattern.next(), path.next()) {
            (None, None) => return true,
            (Some(expected), Some(part)) if expected == part => {}
            (Some(expected), Some(part)) if expected.starts_with('{') && !part.is_empty() => {}
            _ => return false,
        }
    }
}

impl Entry {
    /// Returns whether the route accepts this method.
    pub(super) fn accepts(&self, method: &Method) -> bool {
        let asked = if method == Method::HEAD { "GET" } else { method.as_str() };
        self.methods.contains(&asked)
    }

    /// Makes the answer to a method that the route does not accept.
    pub(super) fn wrong_method(&self) -> Response {
        let head = if self.methods.contains(&"GET") { Some("HEAD") } else { None };
        let allowed: Vec<&str> = self.methods.iter().copied().chain(head).collect();
        let allowed = allowed.join(",");
        let text = format!("This address accepts only {allowed}.\n");
        (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, allowed)], text).into_response()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_has_one_route() {
        for (path, route) in [
            ("/", Some(Route::Front)),
            ("/page/main.js", Some(Route::File)),
            ("/page/", None),
            ("/page/a/b", None),
            ("/api/axes/z/measured", Some(Route::Measured)),
            ("/api/axes//measured", None),
            ("/api/axes/measured", None),
            ("/api/arm", Some(Route::Command(Command::Arm))),
            ("/api/arm/", None),
            ("/api", None),
            ("", None),
            ("//", None),
            ("/metrics", Some(Route::Metrics)),
            ("/metrics/", None),
        ] {
            assert_eq!(at(path).map(|entry| entry.route), route, "{path}");
        }
        for (place, entry) in all().iter().enumerate() {
            assert!(all().iter().skip(place + 1).all(|other| other.path != entry.path), "{}", entry.path);
        }
    }

    #[test]
    fn a_route_accepts_its_methods_and_the_answer_to_others_names_them() {
        let status = at("/api/status").unwrap();
        assert!(status.accepts(&Method::GET) && status.accepts(&Method::HEAD));
        let measured = at("/api/axes/z/measured").unwrap();
        assert!(measured.accepts(&Method::DELETE) && !measured.accepts(&Method::GET));
        assert!(!measured.accepts(&Method::HEAD) && !measured.accepts(&Method::OPTIONS));
        for (entry, allowed) in [(status, "GET,HEAD"), (measured, "POST,DELETE")] {
            let answer = entry.wrong_method();
            assert_eq!(answer.status(), StatusCode::METHOD_NOT_ALLOWED);
            assert_eq!(answer.headers()[header::ALLOW], allowed);
        }
    }
}
