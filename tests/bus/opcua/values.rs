//! Tests of reads and writes, and of the status that is reported for them.

use super::rig::{Line, SHORTLY, Server, machine, profile, with_many};
use isotherm::fieldbus::error::{Fault, Outcome, PeerFault};
use isotherm::fieldbus::wire::{Answer, NodeRequest, Request};
use isotherm_core::codec::{Address, DataType, Node};
use isotherm_core::reading::{Reason, Status};

#[tokio::test]
async fn nodes_are_read_together_and_each_in_its_own_type() {
    let mut server = Server::start(&[]);
    let mut line = Line::to(&server);
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
    server.does("value bed 27.5");
    server.does("value scale -250");
    assert_eq!(line.signals().await, Ok([Ok(27.5), Ok(-0.25)]));
}

#[tokio::test]
async fn a_server_that_takes_one_node_a_call_is_given_one_a_call() {
    let server = Server::start(&["--most", "1"]);
    let mut line = Line::to(&server);
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}

#[tokio::test]
async fn what_is_written_is_read_back_and_stands_at_the_server() {
    let mut server = Server::start(&[]);
    let mut line = Line::to(&server);
    assert_eq!(line.stands().await, Ok(0));
    assert_eq!(line.writes(-37).await, Ok(Answer::Done));
    assert_eq!((line.stands().await, server.does("read offset").as_str()), (Ok(-37), "-37"));
}

#[tokio::test]
async fn a_value_that_is_not_good_is_none_and_says_why() {
    let mut server = Server::start(&[]);
    let mut line = Line::to(&server);
    server.does("status bed BadSensorFailure");
    let (bed, scale) = (Err(Reason::Status(0x808c_0000)), Ok(100.0));
    assert_eq!(line.signals().await, Ok([bed, scale]));
    server.does("status bed UncertainLastUsableValue");
    assert_eq!(line.signals().await, Ok([Err(Reason::Status(0x4090_0000)), scale]));
    server.does("status bed Good");
    assert_eq!(line.signals().await, Ok([Ok(20.0), scale]));
}

#[tokio::test]
async fn a_refusal_that_means_not_done_is_told_apart_from_one_that_may_not() {
    let mut server = Server::start(&[]);
    let mut line = Line::to(&server);
    let cases = [
        ("BadUserAccessDenied", 0x801f_0000, Outcome::NotDone),
        ("BadNotWritable", 0x803b_0000, Outcome::NotDone),
        ("BadTypeMismatch", 0x8074_0000, Outcome::NotDone),
        ("BadOutOfRange", 0x803c_0000, Outcome::NotDone),
        ("BadNodeIdUnknown", 0x8034_0000, Outcome::NotDone),
        ("BadWriteNotSupported", 0x8073_0000, Outcome::Unknown),
        ("BadDeviceFailure", 0x808b_0000, Outcome::Unknown),
        ("BadTimeout", 0x800a_0000, Outcome::Unknown),
        ("UncertainInitialValue", 0x4092_0000, Outcome::Unknown),
    ];
    for (name, code, outcome) in cases {
        server.does(&format!("refuse offset {name}"));
        let fault = line.writes(5).await.unwrap_err();
        assert_eq!((fault, fault.outcome()), (Fault::Status(Status(code)), outcome), "{name}");
        assert_eq!(fault.to_string(), format!("the server answers {name}"));
        assert!(!fault.spoils_connection(), "{name}: the session goes on");
    }
    assert_eq!(line.stands().await, Ok(0));
}

fn many(server: &Server, count: usize) -> Line {
    let directory = tempfile::tempdir().unwrap();
    Line::new(profile(&with_many(&machine(server.port, ""), count), directory.path()))
}

#[tokio::test]
async fn a_call_that_a_server_refuses_because_of_its_size_is_halved_and_the_size_is_remembered() {
    for refusal in
        ["BadTooManyOperations", "BadRequestTooLarge", "BadResponseTooLarge", "BadEncodingLimitsExceeded"]
    {
        let mut server = Server::start(&["--many", "11", "--unsaid", "5", "--refusal", refusal]);
        let mut line = many(&server, 11);
        assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]), "{refusal}");
        assert_eq!(server.does("refusals"), "2", "{refusal}: 13 and 7 nodes, then 4");
        server.does("value bed 27.5");
        assert_eq!(line.signals().await, Ok([Ok(27.5), Ok(100.0)]), "{refusal}");
        server.does("drop");
        let mut answered = line.signals().await;
        for _ in 0..100 {
            if answered.is_ok() {
                break;
            }
            tokio::time::sleep(SHORTLY).await;
            answered = line.signals().await;
        }
        assert_eq!(answered, Ok([Ok(27.5), Ok(100.0)]), "{refusal}");
        assert_eq!(server.does("refusals"), "0", "{refusal}: also with a new session");
    }
}

#[tokio::test]
async fn nodes_that_do_not_fit_into_the_buffers_of_a_server_are_read_in_several_calls() {
    for buffers in ["8192,1,4096", "8192,1,0", "8192,0,0"] {
        let server = Server::start(&["--many", "400", "--buffers", buffers]);
        let mut line = many(&server, 400);
        assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]), "{buffers}");
        assert_eq!(line.exchanges(), 0, "{buffers}: the connection is kept");
    }
}

#[tokio::test]
async fn a_node_that_a_server_refuses_alone_is_bad_and_the_others_are_read() {
    let server = Server::start(&["--huge", "bed", "--refusal", "BadResponseTooLarge"]);
    let mut line = Line::to(&server);
    for _ in 0..2 {
        let bed = Err(Reason::Status(Status::RESPONSE_TOO_LARGE.0));
        assert_eq!(line.signals().await, Ok([bed, Ok(100.0)]));
    }
}

#[tokio::test]
async fn a_text_contradicts_a_type_in_the_profile_and_is_no_number_without_one() {
    let server = Server::start(&[]);
    let directory = tempfile::tempdir().unwrap();
    let text = machine(server.port, "").replace("s=bed", "s=text");
    let mut line = Line::new(profile(&text, directory.path()));
    assert_eq!(line.signals().await, Ok([Err(Reason::NoNumber), Ok(100.0)]));
    let id = "ns=2;s=text".parse().unwrap();
    let address = Address::Node(Node { id, data_type: None });
    let request = Request::read(&address, DataType::F64).unwrap();
    let fault = line.asks(request).await.unwrap().answer.accepted().unwrap_err();
    assert_eq!(fault, Fault::Peer(PeerFault::NotANumber));
    let said = isotherm::fieldbus::explain::explain(fault);
    assert!(said.contains("not a number; write another node") && !said.contains("type"), "{said}");
}

/// Status codes of the server itself, without a script.
#[tokio::test]
async fn a_value_of_another_type_and_a_node_that_nobody_may_write_are_refused_by_the_server() {
    let server = Server::start(&[]);
    let mut line = Line::to(&server);
    let mut write = async |id: &str, data_type: DataType| {
        let node = Node { id: id.parse().unwrap(), data_type: Some(data_type) };
        let value = data_type.encode(7);
        line.asks(Request::Nodes(NodeRequest::Write {
            nodes: std::slice::from_ref(&node),
            values: value.registers(),
        }))
        .await
        .map(|answered| answered.answer)
    };
    let status = |code| Err(Fault::Status(Status(code)));
    assert_eq!(write("ns=2;s=offset", DataType::F64).await, status(0x8074_0000));
    assert_eq!(write("ns=2;s=bed", DataType::F32).await, status(0x801f_0000));
    assert_eq!(write("ns=2;s=offset", DataType::I32).await, Ok(Answer::Done));
}

#[tokio::test]
async fn a_node_of_another_type_than_the_profile_says_is_no_value_and_the_session_goes_on() {
    let server = Server::start(&[]);
    let mut line = Line::to(&server);
    for name in ["scale", "text"] {
        let id = format!("ns=2;s={name}").parse().unwrap();
        let address = Address::Node(Node { id, data_type: Some(DataType::U32) });
        let request = Request::read(&address, DataType::U32).unwrap();
        let answer = line.asks(request).await.unwrap().answer.accepted();
        assert_eq!(answer, Err(Fault::Peer(PeerFault::Type)), "{name}");
    }
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}
