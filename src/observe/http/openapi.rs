//! `GET /openapi.json`: description of the API in OpenAPI 3.1. The paths come from the routes, the schemas from the types
//! of the answers and their comments.

use std::sync::LazyLock;

use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, SchemaGenerator};
use serde_json::{Map, Value, json};

use super::compression;
use super::events::Events;
use super::measured::Measured;
use super::reply::CommandReply;
use super::routes::{self, Route};
use crate::observe::decision_history::Course;
use crate::observe::status::{Command, DialDirection, Status};

const JSON: &str = "application/json";
const PLAIN: &str = "text/plain";

static DOCUMENT: LazyLock<String> = LazyLock::new(|| document().to_string());

pub(super) async fn show(headers: HeaderMap) -> Response {
    // The document is made at the first request, on a separate thread.
    match tokio::task::spawn_blocking(|| DOCUMENT.as_str()).await {
        Ok(text) => compression::file(&headers, "openapi.json", JSON, text).await,
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Clients that may use an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Client {
    /// Any client.
    Any,
    /// Client with any token: the scraper's, the viewer's or the operator's.
    Scraper,
    /// Client with the viewer's or the operator's token.
    Viewer,
    /// Client with the operator's token.
    Operator,
}

/// Operation of the API: one method of a path, with its parameters and its answers.
struct Operation {
    summary: &'static str,
    client: Client,
    parameters: Vec<Value>,
    body: Option<Value>,
    /// HTTP status code and OpenAPI description of each possible answer.
    answers: Vec<(u16, Value)>,
}

/// Makes the OpenAPI document.
fn document() -> Value {
    let settings = SchemaSettings::draft2020_12().for_serialize().with(|settings| {
        settings.definitions_path = "/components/schemas".into();
        settings.meta_schema = None;
    });
    let mut types = settings.into_generator();
    let mut paths = Map::new();
    for entry in routes::all() {
        let mut operations = Map::new();
        for method in entry.methods {
            if let Some(operation) = operation(entry.route, method, &mut types) {
                let id = operation_id(method, &entry.path);
                operations.insert(method.to_ascii_lowercase(), operation.into_json(&id, &mut types));
            }
        }
        if !operations.is_empty() {
            paths.insert(entry.path.clone(), Value::Object(operations));
        }
    }
    let mut document = json!({
        "openapi": "3.1.0",
        "info": {
            "title": "isotherm",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "API of a gateway for the thermal compensation of one machine tool. It is not a safety function.",
            "license": { "name": "Apache-2.0", "identifier": "Apache-2.0" },
        },
        "servers": [{ "url": "." }],
        "paths": paths,
        "components": {
            "schemas": types.take_definitions(true),
            "securitySchemes": {
                "token": {
                    "type": "http",
                    "scheme": "bearer",
                    "description": "Token of the gateway. Without tokens in its profile, programs on its own computer may read.",
                },
            },
        },
    });
    without_rust_words(&mut document);
    document
}

/// Returns an identifier that is unique in the document, for example `get_api_status`.
fn operation_id(method: &str, path: &str) -> String {
    let words = path.split(|one: char| !one.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let words: Vec<String> = std::iter::once(method).chain(words).map(str::to_ascii_lowercase).collect();
    words.join("_")
}

/// Replaces terms of Rust in the descriptions by terms of JSON: `None` by null.
fn without_rust_words(value: &mut Value) {
    match value {
        Value::Object(fields) => fields.iter_mut().for_each(|(key, value)| match value {
            Value::String(text) if key == "description" => *text = text.replace("`None`", "null"),
            value => without_rust_words(value),
        }),
        Value::Array(items) => items.iter_mut().for_each(without_rust_words),
        _ => {}
    }
}

/// Returns the operation of a route; `None` for the routes of the web page.
fn operation(route: Route, method: &str, types: &mut SchemaGenerator) -> Option<Operation> {
    let read = |summary, parameters, answers| Operation {
        summary,
        client: Client::Viewer,
        parameters,
        body: None,
        answers,
    };
    Some(match route {
        Route::Front | Route::File | Route::Login => return None,
        Route::Status => read(
            "State of the whole gateway",
            Vec::new(),
            vec![(200, in_json::<Status>("The state.", types))],
        ),
        Route::Live => {
            let stream = text("Events `status`. The data of each is the state as JSON.", "text/event-stream");
            let full = text("Too many clients watch the gateway.", PLAIN);
            let wrong = text("The parameter is not valid.", PLAIN);
            let about = "Page of the state: fifty devices with their buses, signals, outputs and axes. By default, the \
                         whole state.";
            let page = query("page", about, &json!({ "type": "integer", "minimum": 1 }));
            let answers = vec![(200, stream), (400, wrong), (503, full)];
            read("State once a second, as server-sent events", vec![page], answers)
        }
        Route::Events => read(
            "Events, oldest first",
            vec![query("since", "Begin of the time range: a time, or a duration before now.", &time("12h"))],
            vec![
                (200, in_json::<Events>("The newest 10,000 events of the time range.", types)),
                (400, text("The parameter is not valid.", PLAIN)),
                (500, text("The stored events cannot be read.", PLAIN)),
                (503, text("Too many clients are reading the events. Try again later.", PLAIN)),
            ],
        ),
        Route::History => {
            let points = json!({ "type": "integer", "minimum": 2, "maximum": 4000, "default": 600 });
            let mut parameters = range();
            parameters.push(query("points", "Number of points.", &points));
            let mut answers =
                vec![(200, in_json::<Course>("The smallest and largest values at each point.", types))];
            answers.extend(no_history());
            read("Columns of the logs, for a chart", parameters, answers)
        }
        Route::Download => {
            let mut answers = vec![(200, text("The rows.", "text/csv"))];
            answers.extend(no_history());
            read("Rows of the logs as CSV", range(), answers)
        }
        Route::OpenApi => {
            let document = content("This document.", JSON, &json!({ "type": "object" }));
            read("Description of the API", Vec::new(), vec![(200, document)])
        }
        Route::Ready => read(
            "Whether the gateway is ready",
            Vec::new(),
            vec![
                (200, in_json::<Vec<String>>("The gateway is ready. The list is empty.", types)),
                (503, in_json::<Vec<String>>("The reasons why the machine is not compensated.", types)),
            ],
        ),
        Route::Metrics => Operation {
            client: Client::Scraper,
            ..read("Metrics for Prometheus", Vec::new(), vec![(200, text("The metrics.", PLAIN))])
        },
        Route::Healthy => Operation {
            client: Client::Any,
            ..read("Whether the process answers", Vec::new(), vec![(200, text("`ok`.", PLAIN))])
        },
        Route::Command(command) => {
            let axis =
                query("axis", "Name of an axis. Without it, the command applies to all axes.", &string());
            command_of(summary(command), vec![axis], types)
        }
        Route::Acknowledge => {
            let about = "Name of the alarm. Without it, all active alarms are acknowledged.";
            command_of("Acknowledges alarms", vec![query("alarm", about, &string())], types)
        }
        Route::Measured => {
            let deletes = method == "DELETE";
            let summary = if deletes {
                "Discards what was learned from measured errors"
            } else {
                "Reports a measured error"
            };
            let mut operation = command_of(summary, vec![axis_in_path()], types);
            operation.answers.push((404, text("There is no such axis.", PLAIN)));
            if !deletes {
                operation.answers.push((400, text("The body is not valid.", PLAIN)));
                operation.answers.push((413, text("The body is too long.", PLAIN)));
                operation.body = Some(request_body::<Measured>());
            }
            operation
        }
        // Each client may end its own session.
        Route::Logout => Operation {
            summary: "Ends the session of a browser",
            client: Client::Viewer,
            parameters: Vec::new(),
            body: None,
            answers: vec![(200, in_json::<CommandReply>("The session has ended.", types))],
        },
    })
}

fn summary(command: Command) -> &'static str {
    match command {
        Command::Arm => "Arms axes",
        Command::Disarm => "Disarms axes; the registers keep their values",
        Command::Zero => "Captures zero",
        Command::Cancel => "Withdraws a waiting request to arm, and ends a sign check",
        Command::Sign => "Begins the check of the sign of one axis with a dial gauge",
        Command::Signed(DialDirection::Plus) => "Reports that the gauge moved in the plus direction",
        Command::Signed(DialDirection::Minus) => "Reports that the gauge moved in the minus direction",
        Command::Signed(DialDirection::None) => "Reports that the gauge did not move",
        Command::Adopt => "Adopts the learned model of one axis; Cz does not move",
        Command::AdoptBack => "Returns to the model that one axis preferred before; Cz does not move",
    }
}

fn command_of(summary: &'static str, parameters: Vec<Value>, types: &mut SchemaGenerator) -> Operation {
    let answers = vec![
        (200, in_json::<CommandReply>("The command is done.", types)),
        (202, in_json::<CommandReply>("The command waits.", types)),
        (409, in_json::<CommandReply>("The command is refused.", types)),
    ];
    Operation { summary, client: Client::Operator, parameters, body: None, answers }
}

/// Returns the parameters that describe a time range and a choice of columns.
fn range() -> Vec<Value> {
    let about = "Begin: a time, or a duration before now. By default, eight hours before `to`.";
    let columns = "At most 64 names, separated by commas. By default, the first 64 columns.";
    vec![
        query("from", about, &string()),
        query("to", "End: a time, or a duration before now. By default, now.", &string()),
        query("columns", columns, &string()),
    ]
}

/// Returns the error answers to requests for a time range: HTTP status code and description.
fn no_history() -> [(u16, Value); 4] {
    [
        (400, text("A parameter is not valid.", PLAIN)),
        (404, text("The gateway stores no logs.", PLAIN)),
        (500, text("A log cannot be read.", PLAIN)),
        (503, text("Two requests are reading the logs already, or reading takes too long.", PLAIN)),
    ]
}

fn string() -> Value {
    json!({ "type": "string" })
}

fn time(default: &str) -> Value {
    json!({ "type": "string", "default": default })
}

fn query(name: &str, about: &str, schema: &Value) -> Value {
    json!({ "name": name, "in": "query", "description": about, "schema": schema })
}

fn axis_in_path() -> Value {
    json!({ "name": "axis", "in": "path", "required": true, "description": "Name of the axis.", "schema": string() })
}

fn request_body<T: JsonSchema>() -> Value {
    let schema = T::json_schema(&mut SchemaSettings::draft2020_12().into_generator());
    json!({ "required": true, "content": { JSON: { "schema": schema } } })
}

fn in_json<T: JsonSchema>(about: &str, types: &mut SchemaGenerator) -> Value {
    content(about, JSON, &types.subschema_for::<T>().to_value())
}

fn text(about: &str, kind: &str) -> Value {
    content(about, kind, &string())
}

fn content(about: &str, kind: &str, schema: &Value) -> Value {
    json!({ "description": about, "content": { kind: { "schema": schema } } })
}

impl Operation {
    fn into_json(mut self, id: &str, types: &mut SchemaGenerator) -> Value {
        // Without tokens in the profile, the gateway decides by the address of the client.
        let security = match self.client {
            Client::Any => json!([]),
            Client::Scraper | Client::Viewer | Client::Operator => json!([{}, { "token": [] }]),
        };
        let requires = match self.client {
            Client::Any => "Requires no token.",
            Client::Scraper => "Requires one of the tokens, if the gateway has one.",
            Client::Viewer => "Requires the viewer's or the operator's token, if the gateway has one.",
            Client::Operator => {
                "Requires the operator's token, unless the profile says `commands = \"local\"`."
            }
        };
        if self.client != Client::Any {
            for (code, about) in [
                (401, "There is no token, or it is not a token of this gateway."),
                (403, "The client may not do this."),
                (421, "The request names an unknown host, and the gateway has no token."),
                (
                    429,
                    "The command comes too soon after another, or too many wrong tokens came from this address.",
                ),
            ] {
                self.answers.push((code, in_json::<CommandReply>(about, types)));
            }
        }
        let answers: Map<String, Value> =
            self.answers.into_iter().map(|(code, answer)| (code.to_string(), answer)).collect();
        let mut json = json!({
            "operationId": id,
            "summary": self.summary,
            "description": requires,
            "security": security,
            "responses": answers,
        });
        if !self.parameters.is_empty() {
            json["parameters"] = self.parameters.into();
        }
        if let Some(body) = self.body {
            json["requestBody"] = body;
        }
        json
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Every `$ref` of the document.
    fn references(value: &Value, found: &mut BTreeSet<String>) {
        match value {
            Value::Object(fields) => {
                found.extend(fields.get("$ref").and_then(Value::as_str).map(str::to_owned));
                fields.values().for_each(|value| references(value, found));
            }
            Value::Array(items) => items.iter().for_each(|item| references(item, found)),
            _ => {}
        }
    }

    #[test]
    fn every_schema_that_is_named_is_in_the_document_and_is_used() {
        let document = document();
        let mut found = BTreeSet::new();
        references(&document, &mut found);
        for reference in &found {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(document.pointer(pointer).is_some_and(Value::is_object), "{reference}");
        }
        let known = document["components"]["schemas"].as_object().unwrap();
        assert_eq!(found.len(), known.len(), "{found:?} {:?}", known.keys());
        for name in ["Status", "AxisStatus", "Event", "Alarm", "CommandReply", "Events", "History"] {
            assert!(known.contains_key(name), "{name}");
        }
        assert!(!document.to_string().contains("`None`"));
    }

    #[test]
    fn every_operation_has_its_own_name_and_the_answers_of_its_client() {
        let document = document();
        let mut ids = BTreeSet::new();
        for (path, operations) in document["paths"].as_object().unwrap() {
            for (method, operation) in operations.as_object().unwrap() {
                assert!(ids.insert(operation["operationId"].as_str().unwrap().to_owned()), "{path}");
                let is_open = operation["security"] == json!([]);
                assert_eq!(is_open, path == "/healthz", "{method} {path}");
                assert_eq!(operation["responses"].get("401").is_none(), is_open, "{method} {path}");
                assert!(operation["responses"].get("200").is_some(), "{method} {path}");
            }
        }
        assert!(
            ids.contains("get_api_history_csv") && ids.contains("delete_api_axes_axis_measured"),
            "{ids:?}"
        );
        assert!(document["paths"].get("/").is_none(), "the page is for people");
        let measured = &document["paths"]["/api/axes/{axis}/measured"]["post"];
        let body = &measured["requestBody"]["content"][JSON]["schema"];
        assert_eq!(body["required"], json!(["error_um"]));
        assert_eq!(body["additionalProperties"], false);
    }

    #[test]
    fn a_field_of_the_status_has_its_comment_and_its_type() {
        let document = document();
        let axis = &document["components"]["schemas"]["AxisStatus"];
        assert_eq!(axis["properties"]["cz_um"]["type"], "number");
        assert_eq!(axis["properties"]["raw_um"]["type"], json!(["number", "null"]));
        assert_eq!(axis["properties"]["raw_um"]["description"], "Cz that the model requests, µm.");
        for field in ["shown", "tone", "why", "armed"] {
            assert!(axis["required"].as_array().unwrap().contains(&field.into()), "{field}");
            assert!(axis["properties"][field].is_object(), "{field}");
        }
        assert!(!axis["required"].as_array().unwrap().contains(&"truth".into()));
        assert!(document["components"]["schemas"]["Status"]["properties"].get("language").is_none());
    }
}
