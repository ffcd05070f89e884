//! Connections of clients: their bytes are passed on to the library, until a fault replaces an answer.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use rand::RngExt;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Mutex, mpsc, watch};

use super::library::{Endpoint, Library};
use super::line::{Cut, NodeLine};
use crate::virtual_machine::listener::{self, Switch};
use crate::virtual_machine::random::stream;

/// Bytes that are passed on at once.
const PIECE: usize = 16 * 1024;
/// Interval at which the end of a silence is checked.
const SILENT: Duration = Duration::from_millis(20);

/// Virtual server of one bus.
pub(in crate::virtual_machine) struct NodeServer {
    line: Arc<NodeLine>,
    library: Arc<Mutex<Library>>,
}

impl NodeServer {
    /// Starts the library behind a server.
    ///
    /// # Errors
    /// The library cannot be started.
    pub(in crate::virtual_machine) async fn start(
        line: NodeLine,
        endpoint: &Endpoint,
    ) -> io::Result<NodeServer> {
        let line = Arc::new(line);
        let library = Arc::new(Mutex::new(Library::start(endpoint, &line).await?));
        Ok(NodeServer { line, library })
    }

    /// Serves clients on a listener, until `stop` changes or its sender is dropped.
    pub(in crate::virtual_machine) async fn serve<S: Into<Switch>>(
        self,
        listener: TcpListener,
        switched: mpsc::Receiver<S>,
        stop: watch::Receiver<bool>,
    ) -> io::Result<()> {
        let converse = move |client: TcpStream| relay(client, self.line.clone(), self.library.clone());
        listener::serve(listener, switched, stop, converse).await
    }
}

/// Passes the bytes of one connection on, until an end closes it or the device is started again.
async fn relay(mut client: TcpStream, line: Arc<NodeLine>, library: Arc<Mutex<Library>>) -> io::Result<()> {
    let mut cuts = line.cuts();
    let (mut server, boots) = library.lock().await.connect(&line).await?;
    let (mut from_client, mut to_client) = client.split();
    let (mut from_server, mut to_server) = server.split();
    let (mut asked, mut answered) = (vec![0; PIECE], vec![0; PIECE]);
    loop {
        tokio::select! {
            read = from_client.read(&mut asked) => {
                let count = read?;
                if count == 0 || line.boots() != boots {
                    return Ok(());
                }
                to_server.write_all(&asked[..count]).await?;
            }
            read = from_server.read(&mut answered) => {
                let count = read?;
                if count == 0 {
                    return Ok(());
                }
                while line.is_silent() {
                    tokio::time::sleep(SILENT).await;
                }
                match next_cut(&mut cuts) {
                    Cut::None => to_client.write_all(&answered[..count]).await?,
                    Cut::Close => return Ok(()),
                    Cut::Mute => while from_client.read(&mut asked).await? > 0 {},
                    Cut::Garbage => {
                        let bytes: [u8; 16] = stream(u64::from(boots), "garbage").random();
                        to_client.write_all(&bytes).await?;
                    }
                }
            }
        }
    }
}

/// Returns the fault of the next answer, once.
fn next_cut(cuts: &mut watch::Receiver<Cut>) -> Cut {
    if cuts.has_changed().unwrap_or(false) { *cuts.borrow_and_update() } else { Cut::None }
}
