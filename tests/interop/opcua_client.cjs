// A client of OPC UA that is not ours (node-opcua): does one thing with a server, and prints one line of JSON.
//
//     node opcua_client.cjs NODE_MODULES URL --cert FILE [OPTIONS] VERB
//
//   browse             prints identifier and display name of each node below Objects/Machines
//   read ID…           prints value, status, source time and unit of these nodes
//   write ID NUMBER    tries to write, and prints the status
//   call AXIS ERROR    calls the method `measured`, and prints its outputs
//   watch SECONDS ID…  subscribes, prints `ready`, `changing` at the 20th change of the last node, and at the end
//                      number of changes, statuses and last source time of each node. It ends early when the first
//                      node has lost its device
//   many NUMBER SECONDS ID  the same with so many clients; prints the number of changes of each
//
// A refusal is {"error": NAME OF THE STATUS}. Options and identifiers are those of opcua_client.py, but a policy has
// its name in the specification. node-opcua needs a certificate in any case.

const fs = require("node:fs");
const path = require("node:path");
const { parseArgs } = require("node:util");

const text = { type: "string" };
const options = { user: text, "user-cert": text, cert: text, "server-cert": text, uri: text, policy: text };
const { values: given, positionals } = parseArgs({ options, allowPositionals: true });
const [modules, url, does, ...more] = positionals;

const opcua = require(path.join(modules, "node-opcua-client"));
const { InMemoryCertificateStore } = require(path.join(modules, "node-opcua-common"));

const NAMESPACE = "urn:isotherm:machine";

class Refused extends Error {}

function checked(status) {
    if (status.isNotGood()) throw new Refused(status.name);
}

function say(result) {
    process.stdout.write(JSON.stringify(result) + "\n");
}

async function client() {
    const trusted = new InMemoryCertificateStore({ autoAcceptUnknown: false });
    if (given["server-cert"]) await trusted.trustCertificate(fs.readFileSync(given["server-cert"]));
    return opcua.OPCUAClient.create({
        applicationUri: given.uri ?? "urn:isotherm:test",
        clientCertificateManager: trusted,
        connectionStrategy: { maxRetry: 0 },
        endpointMustExist: false,
        securityMode: opcua.MessageSecurityMode.SignAndEncrypt,
        securityPolicy: opcua.SecurityPolicy[given.policy ?? "Aes256_Sha256_RsaPss"],
        certificateFile: `${given.cert}.der`,
        privateKeyFile: `${given.cert}.pem`,
    });
}

function identity() {
    if (given.user) {
        const [userName, password] = given.user.split(":");
        return { type: opcua.UserTokenType.UserName, userName, password };
    }
    if (given["user-cert"]) {
        const certificateData = fs.readFileSync(`${given["user-cert"]}.der`);
        const privateKey = fs.readFileSync(`${given["user-cert"]}.pem`, "utf8");
        return { type: opcua.UserTokenType.Certificate, certificateData, privateKey };
    }
    return { type: opcua.UserTokenType.Anonymous };
}

// Integers of 64 bits are pairs of 32 bits.
function plain(variant) {
    const { dataType, value } = variant;
    return dataType === opcua.DataType.UInt64 ? value[0] * 2 ** 32 + value[1] : value;
}

async function browsed(session, nodeId, found) {
    const result = await opcua.browseAll(session, {
        nodeId,
        browseDirection: opcua.BrowseDirection.Forward,
        referenceTypeId: "HierarchicalReferences",
        includeSubtypes: true,
        resultMask: 63,
    });
    checked(result.statusCode);
    for (const reference of result.references) {
        found[reference.nodeId.value] = reference.displayName.text;
        await browsed(session, reference.nodeId, found);
    }
    return found;
}

async function read(session, id) {
    const value = await session.read({ nodeId: id(), attributeId: opcua.AttributeIds.Value });
    const unit = await session.read({ nodeId: id(".EngineeringUnits"), attributeId: opcua.AttributeIds.Value });
    return {
        value: plain(value.value),
        status: value.statusCode.name,
        time: value.sourceTimestamp,
        unit: unit.value.value?.displayName.text ?? null,
    };
}

async function watch(session, seconds, names, node) {
    const subscription = await session.createSubscription2({
        requestedPublishingInterval: 100,
        requestedLifetimeCount: 1000,
        requestedMaxKeepAliveCount: 10,
        publishingEnabled: true,
    });
    const asked = { samplingInterval: 100, queueSize: 10, discardOldest: true };
    const items = names.map((name) => ({ nodeId: node(name), attributeId: opcua.AttributeIds.Value }));
    const group = await subscription.monitorItems(items, asked, opcua.TimestampsToReturn.Both);
    const changes = Object.fromEntries(names.map((name) => [name, { count: 0, statuses: [], time: null }]));
    const over = new Promise((end) => {
        setTimeout(end, 1000 * seconds);
        group.on("changed", (_, value, place) => {
            const change = changes[names[place]];
            // On a busy computer, `#` and a word follow, which say that the queue of the item was full.
            const status = value.statusCode.name.split("#")[0];
            change.count += 1;
            change.time = value.sourceTimestamp;
            if (change.statuses.at(-1) !== status) change.statuses.push(status);
            if (place === names.length - 1 && change.count === 20) process.stdout.write("changing\n");
            if (place === 0 && status.includes("NoCommunication")) end();
        });
    });
    process.stdout.write("ready\n");
    await over;
    await subscription.terminate();
    return changes;
}

async function naming(session) {
    const index = (await session.readNamespaceArray()).indexOf(NAMESPACE);
    return (name) => `ns=${index};s=${name}`;
}

async function one(session) {
    const node = await naming(session);
    switch (does) {
        case "browse":
            return browsed(session, node("Machines"), {});
        case "read": {
            const found = {};
            for (const name of more) found[name] = await read(session, (end = "") => node(name + end));
            return found;
        }
        case "write": {
            const value = { value: { dataType: opcua.DataType.Double, value: Number(more[1]) } };
            checked(await session.write({ nodeId: node(more[0]), attributeId: opcua.AttributeIds.Value, value }));
            return "written";
        }
        case "call": {
            const { Double, String } = opcua.DataType;
            const inputArguments = [
                { dataType: Double, value: Number(more[1]) },
                { dataType: String, value: "" },
                { dataType: String, value: "" },
            ];
            const [objectId, methodId] = [node(`axis.${more[0]}`), node(`axis.${more[0]}.measured`)];
            const answer = await session.call({ objectId, methodId, inputArguments });
            checked(answer.statusCode);
            return answer.outputArguments.map(plain);
        }
        case "watch":
            return watch(session, Number(more[0]), more.slice(1), node);
        default:
            throw new Error(`${does}?`);
    }
}

async function connected(does) {
    const made = await client();
    try {
        await made.connect(url);
        const session = await made.createSession(identity());
        try {
            return await does(session);
        } finally {
            await session.close();
        }
    } finally {
        await made.disconnect();
    }
}

async function many(number, seconds, name) {
    const watched = async (session) => watch(session, seconds, [name], await naming(session));
    const clients = Array.from({ length: number }, () => connected(watched));
    return { counts: (await Promise.all(clients)).map((changes) => changes[name].count) };
}

function main() {
    return does === "many" ? many(Number(more[0]), Number(more[1]), more[2]) : connected(one);
}

function refusal(error) {
    const status = error instanceof Refused ? error.message : /Bad[A-Z]\w+/.exec(error.message)?.[0];
    return { error: status ?? error.name, text: error.message };
}

// Without the exit, a connection that was refused would keep the process running.
main()
    .catch(refusal)
    .then(say)
    .then(() => process.exit(0));
