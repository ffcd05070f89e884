//! The client with scripted brokers, which answer with exact bytes.

use super::*;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

/// A broker acknowledges many messages while a command arrives.
#[tokio::test]
async fn a_message_that_arrives_beside_many_acknowledgements_is_not_lost() {
    let (news, mut inbox) = inbox(None);
    (0..10 * UNHEARD).for_each(|_| news.room.notify_one());
    let arrived =
        ReceivedMessage { topic: "t".to_owned(), payload: Vec::new(), retained: true, redelivered: false };
    assert!(news.heard.try_send(BrokerReport::Arrived(arrived)).is_ok());
    assert!(matches!(inbox.next().await, Some(BrokerReport::Arrived(_))));
    assert!(matches!(inbox.next().await, Some(BrokerReport::Room)));
    drop(news);
    assert!(inbox.next().await.is_none());
}

/// Anyone who may send commands could otherwise keep the state of the host from the gateway.
#[tokio::test]
async fn the_newest_state_of_the_host_outlasts_a_flood_of_other_messages() {
    let (news, mut inbox) = inbox(Some("state".to_owned()));
    let message = |topic: &str, number: u8| ReceivedMessage {
        topic: topic.to_owned(),
        payload: vec![number],
        retained: false,
        redelivered: false,
    };
    news.arrived(message("state", 1));
    (0..2 * UNHEARD).for_each(|_| news.arrived(message("command", 0)));
    (2..5).for_each(|number| news.arrived(message("state", number)));
    let mut states = Vec::new();
    for _ in 0..=UNHEARD {
        let Some(BrokerReport::Arrived(arrived)) = inbox.next().await else { panic!("messages wait") };
        if arrived.topic == "state" {
            states.push(arrived.payload[0]);
        }
    }
    assert_eq!(states, [1, 4], "the first had a place, and the last is the newest");
    news.arrived(message("state", 5));
    assert!(matches!(inbox.next().await, Some(BrokerReport::Arrived(last)) if last.payload == [5]));
}

fn client(port: u16) -> Client {
    Client {
        to: BrokerUrl { tls: false, host: "127.0.0.1".to_owned(), port },
        id: "isotherm-press".to_owned(),
        user: None,
        host: Arc::new(Host::new("127.0.0.1", port, None)),
        clock: Clock::wall(),
        state_topic: None,
        is_open: Arc::default(),
    }
}

/// Reads a packet. Returns its first byte, and its content.
async fn packet(stream: &mut TcpStream) -> (u8, Vec<u8>) {
    let (first, mut length, mut shift) = (stream.read_u8().await.unwrap(), 0, 0);
    loop {
        let byte = usize::from(stream.read_u8().await.unwrap());
        length |= (byte & 0x7f) << shift;
        shift += 7;
        if byte < 0x80 {
            break;
        }
    }
    let mut content = vec![0; length];
    stream.read_exact(&mut content).await.unwrap();
    (first, content)
}

/// Connects to a broker that answers the CONNECT packet with these bytes.
async fn answered(answer: &'static [u8]) -> Fault {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let client = client(listener.local_addr().unwrap().port());
    let broker = async {
        let (mut stream, _) = listener.accept().await.unwrap();
        assert_eq!(packet(&mut stream).await.0, 0x10, "CONNECT");
        stream.write_all(answer).await.unwrap();
    };
    let answered = tokio::join!(client.connect(None), broker).0;
    assert_eq!(client.packet(), ConnectPacket::Sent, "{answer:?}");
    match answered {
        Ok(_) => panic!("{answer:?} accepts"),
        Err(fault) => fault,
    }
}

#[tokio::test]
async fn a_broker_that_refuses_the_gateway_says_why() {
    let mqtt_5 = "speaks MQTT 5 only";
    let table: [(&'static [u8], &str); 9] = [
        (&[0x20, 2, 0, 0x84], mqtt_5),
        // With the properties of MQTT 5, without and with content.
        (&[0x20, 3, 0, 0x84, 0], mqtt_5),
        (&[0x20, 8, 0, 0x84, 5, 0x1f, 0, 2, b'n', b'o'], mqtt_5),
        (&[0x20, 2, 0, 1], "does not support MQTT 3.1.1"),
        (&[0x20, 2, 0, 0x86], "rejects this user name or password"),
        (&[0x20, 2, 0, 0x87], "does not allow the gateway to connect"),
        (&[0x20, 2, 0, 5], "does not allow the gateway to connect"),
        (&[0x20, 2, 0, 0x42], "does not speak MQTT"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "does not speak MQTT"),
    ];
    for (answer, words) in table {
        let why = answered(answer).await.to_string();
        assert!(why.contains(words), "{answer:?}: {why}");
    }
}

#[tokio::test]
async fn a_computer_without_a_broker_gets_no_connect_packet() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    drop(listener);
    let client = client(port);
    let Err(fault) = client.connect(None).await else { panic!("nothing listens") };
    assert_eq!(client.packet(), ConnectPacket::NotSent);
    assert_eq!(fault.to_string(), "no program listens at this port");
}

/// The stop may end an attempt at any time.
#[tokio::test]
async fn an_attempt_that_is_under_way_tells_whether_its_packet_was_sent() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let client = client(listener.local_addr().unwrap().port());
    let broker = async {
        let (mut stream, _) = listener.accept().await.unwrap();
        packet(&mut stream).await;
        client.packet()
    };
    let sent = tokio::select! {
        sent = broker => sent,
        _ = client.connect(None) => panic!("nothing answers"),
    };
    assert_eq!(sent, ConnectPacket::Sent);
}

/// Result of a subscription at a broker that answers with this code; `None` closes the connection.
async fn subscribed(code: Option<u8>) -> Result<SubscriptionAnswer, Fault> {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let client = client(listener.local_addr().unwrap().port());
    let broker = async {
        let (mut stream, _) = listener.accept().await.unwrap();
        packet(&mut stream).await;
        stream.write_all(&[0x20, 2, 0, 0]).await.unwrap();
        let (first, content) = packet(&mut stream).await;
        assert_eq!(first, 0x82, "SUBSCRIBE");
        let code = code?;
        // A retained message may come before the answer.
        stream.write_all(&[0x31, 4, 0, 1, b't', b'x']).await.unwrap();
        stream.write_all(&[0x90, 3, content[0], content[1], code]).await.unwrap();
        Some(stream)
    };
    let gateway = async {
        let Ok(mut connection) = client.connect(None).await else { panic!("it accepts the gateway") };
        let subscription = Subscription { filter: "g/press/command/+".to_owned(), qos: Qos::AtLeastOnce };
        let answer = connection.subscribe(&subscription).await;
        if answer.is_ok() {
            let report = connection.next().await;
            assert!(!matches!(report, BrokerReport::Lost(_)), "{report:?}");
        }
        answer
    };
    tokio::join!(gateway, broker).0
}

#[tokio::test]
async fn the_answer_to_a_subscription_is_known() {
    let refused = "g/press/command/+".to_owned();
    for (code, answer) in [
        (Some(0), Ok(SubscriptionAnswer::Accepted)),
        (Some(1), Ok(SubscriptionAnswer::Accepted)),
        (Some(0x80), Ok(SubscriptionAnswer::Refused)),
        (Some(0x87), Err(Fault::NotSubscribed(refused.clone()))),
        (None, Err(Fault::NotSubscribed(refused))),
    ] {
        assert_eq!(subscribed(code).await, answer, "{code:?}");
    }
}

#[tokio::test]
async fn a_message_without_acknowledgement_is_done_when_the_requested_answer_is_there() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let client = client(listener.local_addr().unwrap().port());
    let broker = async {
        let (mut stream, _) = listener.accept().await.unwrap();
        packet(&mut stream).await;
        stream.write_all(&[0x20, 2, 0, 0]).await.unwrap();
        let (first, _) = packet(&mut stream).await;
        assert_eq!(first, 0x30, "PUBLISH with QoS 0 comes first");
        let (first, content) = packet(&mut stream).await;
        assert_eq!(first, 0xa2, "UNSUBSCRIBE");
        tokio::time::sleep(Duration::from_millis(100)).await;
        stream.write_all(&[0xb0, 2, content[0], content[1]]).await.unwrap();
        stream
    };
    let gateway = async {
        let Ok(mut connection) = client.connect(None).await else { panic!("it accepts the gateway") };
        let message =
            Message { topic: "t".to_owned(), payload: vec![1], qos: Qos::AtMostOnce, retained: false };
        assert!(connection.send(message, Moment::default()).is_ok());
        connection.request_answer("t");
        assert!(!connection.is_done());
        while !connection.is_done() {
            let report = connection.next().await;
            assert!(!matches!(report, BrokerReport::Lost(_)), "{report:?}");
        }
    };
    tokio::time::timeout(Duration::from_secs(20), async { tokio::join!(gateway, broker) }).await.unwrap();
}
