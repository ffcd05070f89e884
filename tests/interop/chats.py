"""Webhooks of Slack, of Teams and of ntfy, in one server. Each checks a message as its documentation describes it, and answers as it does.

    chats.py

Prints its port. Each request then becomes a line of JSON: the service, the status code, and the text that people would see.

- Slack: https://docs.slack.dev/messaging/sending-messages-using-incoming-webhooks
- Teams: https://learn.microsoft.com/connectors/teams, "When a Teams webhook request is received"; the card is of https://adaptivecards.io/explorer
- ntfy: https://docs.ntfy.sh/publish/#publish-as-json
"""

import http.server
import json

from jsonschema import Draft202012Validator

SLACK = {
    "type": "object",
    "required": ["text"],
    "properties": {
        "text": {"type": "string", "minLength": 1, "maxLength": 40000},
        "blocks": {"type": "array", "maxItems": 50},
    },
    "additionalProperties": False,
}

TEXT_BLOCK = {
    "type": "object",
    "required": ["type", "text"],
    "properties": {
        "type": {"const": "TextBlock"},
        "text": {"type": "string", "minLength": 1},
        "wrap": {"type": "boolean"},
        "weight": {"enum": ["lighter", "default", "bolder"]},
        "size": {"enum": ["default", "small", "medium", "large", "extraLarge"]},
        "color": {"enum": ["default", "dark", "light", "accent", "good", "warning", "attention"]},
        "isSubtle": {"type": "boolean"},
        "separator": {"type": "boolean"},
    },
    "additionalProperties": False,
}

TEAMS = {
    "type": "object",
    "required": ["type", "attachments"],
    "properties": {
        "type": {"const": "message"},
        "attachments": {
            "type": "array",
            "minItems": 1,
            "items": {
                "type": "object",
                "required": ["contentType", "content"],
                "properties": {
                    "contentType": {"const": "application/vnd.microsoft.card.adaptive"},
                    "contentUrl": {"type": "null"},
                    "content": {
                        "type": "object",
                        "required": ["type", "version", "body"],
                        "properties": {
                            "$schema": {"const": "http://adaptivecards.io/schemas/adaptive-card.json"},
                            "type": {"const": "AdaptiveCard"},
                            "version": {"enum": ["1.0", "1.1", "1.2", "1.3", "1.4", "1.5"]},
                            "body": {"type": "array", "minItems": 1, "items": TEXT_BLOCK},
                        },
                        "additionalProperties": False,
                    },
                },
                "additionalProperties": False,
            },
        },
    },
    "additionalProperties": False,
}

NTFY = {
    "type": "object",
    "required": ["topic"],
    "properties": {
        "topic": {"type": "string", "pattern": "^[-_A-Za-z0-9]{1,64}$"},
        "title": {"type": "string"},
        # A longer message becomes an attachment.
        "message": {"type": "string", "minLength": 1, "maxLength": 4096},
        "tags": {"type": "array", "items": {"type": "string"}},
        "priority": {"type": "integer", "minimum": 1, "maximum": 5},
        "click": {"type": "string"},
        "markdown": {"type": "boolean"},
    },
    "additionalProperties": False,
}


def of_slack(message):
    return message["text"]


def of_teams(message):
    return "\n".join(block["text"] for block in message["attachments"][0]["content"]["body"])


def of_ntfy(message):
    tags = ",".join(message.get("tags", []))
    return f'{message.get("title", "")} [{tags}] {message["message"]}'


WORKFLOW = (
    "/powerautomate/automations/direct/workflows/1/triggers/manual/paths/invoke"
    "?api-version=1&sp=%2Ftriggers%2Fmanual%2Frun&sv=1.0&sig=secret"
)

# Path, name, schema, code of success, and the text that is shown.
SERVICES = [
    ("/services/T0/B1/secret", "slack", SLACK, 200, of_slack),
    (WORKFLOW, "teams", TEAMS, 202, of_teams),
    ("/", "ntfy", NTFY, 200, of_ntfy),
]


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        service = next((service for service in SERVICES if service[0] == self.path), None)
        if service is None:
            return self.answer("none", 404, self.path)
        _, name, schema, code, shown = service
        token = self.headers["Authorization"]
        if token != ("Bearer tk_secret" if name == "ntfy" else None):
            return self.answer(name, 403, str(token))
        if self.headers["Content-Type"] != "application/json":
            return self.answer(name, 400, "not application/json")
        try:
            message = json.loads(body.decode("utf-8"))
        except ValueError as error:
            return self.answer(name, 400, str(error))
        wrong = [error.message for error in Draft202012Validator(schema).iter_errors(message)]
        if wrong:
            return self.answer(name, 400, "; ".join(wrong))
        return self.answer(name, code, shown(message))

    def answer(self, name, code, shown):
        # The line comes first: who has the answer can read the line.
        print(json.dumps({"service": name, "code": code, "shown": shown}), flush=True)
        self.send_response(code)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_):
        pass


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
print("at", server.server_address[1], flush=True)
server.serve_forever()
