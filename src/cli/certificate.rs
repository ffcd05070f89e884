//! Certificate of the web page. It is read from its files, and read again when the files change.

use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use tokio::sync::watch;
use tokio_rustls::rustls::ServerConfig;

use crate::clock::Ticks;
use crate::fieldbus::tls;
use crate::observe::http::TlsReceiver;
use isotherm_profile::{WebTls, safe_file};

/// Interval at which the certificate files are checked for changes. Changed files are read only if two successive
/// checks find the same state, because certificate and key cannot be replaced at the same moment.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// TLS configuration of the web page's server, and the paths of its certificate file and key file.
#[derive(Debug)]
pub(super) struct Certificate {
    files: WebTls,
    read: Stamp,
    show: watch::Sender<Arc<ServerConfig>>,
}

/// State of the certificate file and of the key file: inode number, size, and modification time in seconds and
/// nanoseconds. `None` if the metadata cannot be read. A different value means that a file was replaced or changed.
type Stamp = [Option<(u64, u64, i64, i64)>; 2];

impl Certificate {
    /// Reads the files with certificate and key.
    ///
    /// # Errors
    /// A sentence that names the file and the error in it.
    pub(super) fn open(files: &WebTls) -> anyhow::Result<Certificate> {
        let read = stamp(files);
        Ok(Certificate { files: files.clone(), read, show: watch::Sender::new(Arc::new(config(files)?)) })
    }

    /// Returns a receiver of the current TLS configuration, which changes when new certificate files are read.
    pub(super) fn shown(&self) -> TlsReceiver {
        self.show.subscribe()
    }

    /// Reads the files again whenever they change. If the new files have an error, the web page continues to use the
    /// old certificate.
    pub(super) async fn keep(mut self) {
        let mut last = self.read;
        let mut ticks = Ticks::every(LOOK_EVERY);
        loop {
            ticks.next().await;
            let files = self.files.clone();
            // A file may be on a network that is gone. Only this thread then waits for it.
            let Ok(found) = tokio::task::spawn_blocking(move || stamp(&files)).await else { return };
            if found != self.read && found == last {
                self.read = found;
                let files = self.files.clone();
                let Ok(read) = tokio::task::spawn_blocking(move || config(&files)).await else { return };
                match read {
                    Ok(config) => {
                        self.show.send_replace(Arc::new(config));
                        tracing::info!(
                            "the web page uses the new certificate in {}",
                            self.files.cert.display()
                        );
                    }
                    Err(why) => tracing::warn!("the web page still uses its old certificate: {why:#}"),
                }
            }
            last = found;
        }
    }
}

fn config(files: &WebTls) -> anyhow::Result<ServerConfig> {
    let read = |path: &Path| {
        safe_file::read(path, safe_file::LARGEST)
            .with_context(|| format!("the web page's {} cannot be read (web.tls)", path.display()))
    };
    let (cert, key) = (read(&files.cert)?, read(&files.key)?);
    tls::server(&cert, &key).map_err(|wrong| {
        let (file, why) = match wrong {
            tls::Wrong::Cert(why) => (&files.cert, why),
            tls::Wrong::Key(why) => (&files.key, why),
        };
        anyhow::anyhow!("the web page's {} (web.tls): {why}", file.display())
    })
}

fn stamp(files: &WebTls) -> Stamp {
    [&files.cert, &files.key].map(|path| {
        let found = std::fs::metadata(path).ok()?;
        Some((found.ino(), found.size(), found.mtime(), found.mtime_nsec()))
    })
}
