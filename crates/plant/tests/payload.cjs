// sparkplug-payload's decoder and encoder, for tests of the edge node.
//
//     node payload.cjs NODE_MODULES
//
// Line by line from stdin, JSON each; each is answered with a line of JSON.
//   {"topic": TOPIC, "payload": HEX}                              what the message says; names and types come from the last birth
//   {"command": NAME, "value": VALUE, "type": TYPE, "sent": MS}   the topic and the bytes of a command to shop/grinder-3

const path = require("node:path");
const readline = require("node:readline");

const sparkplug = require(path.join(process.argv[2], "sparkplug-payload")).get("spBv1.0");

// Number of each type in the specification, by the name that the library gives it.
const NUMBERS = { Int32: 3, Int64: 4, UInt64: 8, Double: 10, Boolean: 11, String: 12 };

let birth = new Map();

// Integers of 64 bits are objects of the library `long`.
function plain(value) {
    return value !== null && typeof value === "object" && "unsigned" in value ? Number(value.toString()) : value;
}

function described(metric) {
    const properties = {};
    for (const [key, property] of Object.entries(metric.properties ?? {})) {
        properties[key] = [property.type, plain(property.value)];
    }
    return {
        name: metric.name,
        alias: plain(metric.alias ?? null),
        type: metric.type,
        value: plain(metric.value ?? null),
        timestamp: plain(metric.timestamp ?? null),
        historical: metric.isHistorical === true,
        properties,
    };
}

function varint(bytes, at) {
    let value = 0n;
    for (let shift = 0n; ; shift += 7n) {
        const byte = bytes[at++];
        value |= BigInt(byte & 0x7f) << shift;
        if (byte < 0x80) return [value, at];
    }
}

function varintBytes(value) {
    const bytes = [];
    for (; value > 0x7f; value = Math.floor(value / 128)) bytes.push((value % 128) | 0x80);
    return Buffer.from([...bytes, value]);
}

// The place behind a field of Protocol Buffers, and its number and content.
function field(bytes, at) {
    const [key, begin] = varint(bytes, at);
    const [number, wire] = [Number(key >> 3n), Number(key & 7n)];
    if (wire === 0) {
        const [value, end] = varint(bytes, begin);
        return { number, value, end };
    }
    if (wire === 1) return { number, end: begin + 8 };
    if (wire === 5) return { number, end: begin + 4 };
    const [length, content] = varint(bytes, begin);
    const end = content + Number(length);
    return { number, content: bytes.subarray(content, end), end };
}

// Data messages leave the types out, as the specification says. The library reads a value by its type alone, so that a host adds the type
// that the birth has for the alias.
function typed(bytes) {
    const parts = [];
    for (let at = 0; at < bytes.length; ) {
        const part = field(bytes, at);
        if (part.number !== 2) {
            parts.push(bytes.subarray(at, part.end));
        } else {
            let alias = null;
            for (let place = 0; place < part.content.length; ) {
                const inner = field(part.content, place);
                if (inner.number === 2) alias = Number(inner.value);
                if (inner.number === 4) throw new Error("a data message has a type");
                place = inner.end;
            }
            if (!birth.has(alias)) throw new Error(`the birth has no alias ${alias}`);
            const metric = Buffer.concat([part.content, Buffer.from([0x20, NUMBERS[birth.get(alias).type]])]);
            parts.push(Buffer.from([0x12]), varintBytes(metric.length), metric);
        }
        at = part.end;
    }
    return Buffer.concat(parts);
}

function decoded(topic, bytes) {
    const [space, group, kind, node, ...rest] = topic.split("/");
    if (space !== "spBv1.0" || group !== "shop" || node !== "grinder-3" || rest.length > 0) throw new Error(topic);
    const payload = sparkplug.decodePayload(kind === "NDATA" ? typed(bytes) : bytes);
    const metrics = payload.metrics.map(described);
    if (kind === "NBIRTH") birth = new Map(metrics.map((metric) => [metric.alias, metric]));
    if (kind === "NDATA") for (const metric of metrics) metric.name = birth.get(metric.alias).name;
    return { kind, seq: plain(payload.seq ?? null), timestamp: plain(payload.timestamp ?? null), metrics };
}

function command(asked) {
    const metric = { name: asked.command, timestamp: asked.sent, type: asked.type, value: asked.value };
    const bytes = sparkplug.encodePayload({ timestamp: asked.sent, metrics: [metric] });
    return { topic: "spBv1.0/shop/NCMD/grinder-3", payload: Buffer.from(bytes).toString("hex") };
}

readline.createInterface({ input: process.stdin }).on("line", (line) => {
    const asked = JSON.parse(line);
    const answer = "command" in asked ? command(asked) : decoded(asked.topic, Buffer.from(asked.payload, "hex"));
    process.stdout.write(JSON.stringify(answer) + "\n");
});
