//! Tests of servers that close connections, lose the first request of each connection, or answer late.

use super::*;
use crate::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm_profile::Gateway;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

/// Behaviour of a server on each connection.
#[derive(Clone, Copy, Debug)]
struct Server {
    /// Number of requests that it loses at first.
    loses: u32,
    /// Number of answers after which the server closes the connection, and number after which it does not answer any
    /// more.
    closes_after: u32,
    stops_after: u32,
    /// Time that it needs for the first answer of a connection.
    first_takes: Duration,
    /// Time after which it answers unit 1 with the number of another unit.
    foreign_after: Option<Duration>,
}

const USUAL: Server = Server {
    loses: 0,
    closes_after: u32::MAX,
    stops_after: u32::MAX,
    first_takes: Duration::ZERO,
    foreign_after: None,
};

/// Requests that have arrived: number of the connection, and function.
type Arrived = Arc<Mutex<Vec<(u32, u8)>>>;

struct Opens {
    server: Server,
    arrived: Arrived,
    opened: u32,
}

impl Dial for Opens {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        self.opened += 1;
        let (ours, mut theirs) = tokio::io::duplex(512);
        let (server, arrived, connection) = (self.server, self.arrived.clone(), self.opened);
        tokio::spawn(async move {
            let (mut question, mut lost, mut answers) = ([0; 12], 0, 0);
            while answers < server.closes_after && theirs.read_exact(&mut question).await.is_ok() {
                arrived.lock().unwrap().push((connection, question[7]));
                if lost < server.loses || answers >= server.stops_after {
                    lost += 1;
                    continue;
                }
                if let Some(span) = server.foreign_after.filter(|_| question[6] == 1) {
                    tokio::time::sleep(span).await;
                    let foreign = [question[0], question[1], 0, 0, 0, 3, 9, question[7] | 0x80, 11];
                    theirs.write_all(&foreign).await.unwrap();
                    continue;
                }
                if answers == 0 {
                    tokio::time::sleep(server.first_takes).await;
                }
                // Reads are of one register, with the number of the connection. A write is repeated.
                let answer = match question[7] {
                    6 => question.to_vec(),
                    _ => {
                        let head = [question[0], question[1], 0, 0, 0, 5, question[6], question[7], 2, 0];
                        [&head[..], &[u8::try_from(connection).unwrap()]].concat()
                    }
                };
                if theirs.write_all(&answer).await.is_err() {
                    return;
                }
                answers += 1;
            }
        });
        Box::pin(std::future::ready(Ok(Connection::ModbusTcp(ModbusTcp::new(ours, tap)))))
    }
}

/// Returns a line to such a server, with timeouts of 300 ms.
fn line_to(server: Server, change: impl Fn(&mut Device)) -> (Rig, Arrived) {
    let (mut line, _) = line(|device| {
        device.quirks.gateway = Gateway::Absent;
        change(device);
    });
    let arrived = Arrived::default();
    line.line.dial = Box::new(Opens { server, arrived: arrived.clone(), opened: 0 });
    (line, arrived)
}

fn arrived(arrived: &Arrived) -> Vec<(u32, u8)> {
    std::mem::take(&mut *arrived.lock().unwrap())
}

/// Returns the answer to a read on the connection with this number.
fn read_on(connection: u16) -> Result<Answer, Fault> {
    Ok(Answer::Registers(vec![connection]))
}

#[tokio::test(start_paused = true)]
async fn a_late_answer_over_tcp_costs_one_poll_and_no_connection() {
    let slow = Server { first_takes: Duration::from_millis(400), ..USUAL };
    let (mut line, requests) = line_to(slow, |_| {});
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Timeout));
    for at in [2000, 2100, 2200] {
        assert_eq!(line.ask(0, READ, at).await, read_on(1), "{at}");
    }
    assert_eq!(arrived(&requests), [(1, 3); 4]);
}

#[tokio::test(start_paused = true)]
async fn a_wrong_late_answer_to_one_unit_costs_the_next_unit_another_connection_and_nothing_else() {
    let wrong = Server { foreign_after: Some(Duration::from_millis(400)), ..USUAL };
    let (mut line, requests) = line_to(wrong, |device| device.quirks.gateway = Gateway::ByUnits);
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Timeout));
    assert_eq!(line.ask(1, READ, 300).await, read_on(2));
    assert!(!line.is_backing_off(1, 300));
    assert_eq!(arrived(&requests), [(1, 3), (2, 3)]);
}

#[tokio::test(start_paused = true)]
async fn a_connection_on_which_nothing_is_answered_is_replaced_after_as_many_timeouts_as_there_are_devices() {
    let (mut line, requests) = line_to(Server { loses: u32::MAX, ..USUAL }, |_| {});
    for at in [0, 10_000, 20_000, 50_000] {
        assert_eq!(line.ask(0, READ, at).await, Err(Fault::Timeout), "{at}");
    }
    assert_eq!(arrived(&requests), [(1, 3), (1, 3), (1, 3), (2, 3)]);
}

/// The connection has worked before, for example until a firewall has forgotten it.
#[tokio::test(start_paused = true)]
async fn after_the_last_timeout_on_a_connection_that_has_worked_the_next_one_is_tried_without_a_pause() {
    let (mut line, requests) = line_to(Server { stops_after: 1, ..USUAL }, |_| {});
    assert_eq!(line.ask(0, READ, 0).await, read_on(1));
    for at in [1000, 11_000, 21_000] {
        assert_eq!(line.ask(0, READ, at).await, Err(Fault::Timeout), "{at}");
    }
    assert_eq!(line.ask(0, READ, 21_300).await, read_on(2));
    assert_eq!(arrived(&requests), [(1, 3), (1, 3), (1, 3), (1, 3), (2, 3)]);
}

/// The system may still hold the bytes of a write that is not acknowledged.
#[tokio::test(start_paused = true)]
async fn after_the_timeout_of_a_write_the_connection_is_a_new_one() {
    let (mut line, requests) = line_to(Server { loses: 1, ..USUAL }, |_| {});
    assert_eq!(line.ask(0, WRITE, 0).await, Err(Fault::Timeout));
    assert_eq!(line.ask(0, WRITE, 10_000).await, Err(Fault::Timeout));
    assert_eq!(arrived(&requests), [(1, 6), (2, 6)]);
}

#[tokio::test(start_paused = true)]
async fn a_server_that_closes_after_each_answer_gets_a_connection_for_each_request_and_no_pause() {
    let (mut line, requests) = line_to(Server { closes_after: 1, ..USUAL }, |_| {});
    for poll in 0..20_u16 {
        assert_eq!(line.ask(0, READ, u64::from(poll) * 1000).await, read_on(poll + 1), "{poll}");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    // The server closes each connection anyway, so a write may be sent on the next one.
    let here = SendDeadline::OnConnection(Moment::END);
    assert_eq!(line.ask_by(0, WRITE, 20_000, here).await, Ok(Answer::Done));
    assert_eq!(arrived(&requests).len(), 21, "each request has arrived once");
}

/// The outcome of a write on a connection that the server has closed would be unknown.
#[tokio::test(start_paused = true)]
async fn a_write_at_once_after_the_only_answer_of_a_connection_is_not_sent() {
    let (mut line, requests) = line_to(Server { closes_after: 1, ..USUAL }, |_| {});
    assert_eq!(line.ask(0, READ, 0).await, read_on(1));
    tokio::time::sleep(Duration::from_millis(1)).await;
    let here = SendDeadline::OnConnection(Moment::END);
    assert_eq!(line.ask_by(0, WRITE, 0, here).await, Err(Fault::CLOSED));
    assert_eq!(arrived(&requests), [(1, 3)]);
}

#[tokio::test(start_paused = true)]
async fn a_server_that_closes_after_some_answers_is_no_sign_of_another_client_either() {
    let (mut line, requests) = line_to(Server { closes_after: 2, ..USUAL }, |_| {});
    for poll in 0..20_u16 {
        assert_eq!(line.ask(0, READ, u64::from(poll) * 1000).await, read_on(poll / 2 + 1), "{poll}");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(arrived(&requests).len(), 20);
}

#[tokio::test(start_paused = true)]
async fn a_device_that_loses_the_first_request_gets_a_read_before_it_and_each_write_once() {
    for request in [READ, WRITE] {
        let (mut line, requests) =
            line_to(Server { loses: 1, ..USUAL }, |device| device.quirks.loses_first_request = true);
        let answer = line.ask(0, request, 0).await;
        let function = request.function();
        assert!(answer.is_ok(), "{request}: {answer:?}");
        assert_eq!(arrived(&requests), [(1, 3), (1, function)], "{request}");
        assert!(line.ask(0, request, 100).await.is_ok());
        assert_eq!(arrived(&requests), [(1, function)], "{request}: once on each connection");
    }
    let (mut line, requests) = line_to(USUAL, |device| device.quirks.loses_first_request = true);
    assert_eq!(line.ask(0, WRITE, 0).await, Ok(Answer::Done), "a device that answers the read");
    assert_eq!(arrived(&requests), [(1, 3), (1, 6)]);
}
