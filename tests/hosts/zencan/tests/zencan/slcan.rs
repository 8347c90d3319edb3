//! zencan-client's bus over slcan by network.

use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedWriteHalf;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use zencan_client::common::CanMessage;
use zencan_client::common::messages::CanId;
use zencan_client::common::traits::{AsyncCanReceiver, AsyncCanSender, CanSendError};

/// Frames to the bus.
#[derive(Debug)]
pub struct Sender(OwnedWriteHalf);

/// Frames of the bus.
#[derive(Debug)]
pub struct Receiver(UnboundedReceiver<CanMessage>);

/// A frame that was not sent.
#[derive(Debug)]
pub struct NotSent(CanMessage);

/// The connection has ended.
#[derive(Debug)]
pub struct Ended;

/// Opens the bus behind an address.
pub async fn open(address: &str) -> (Sender, Receiver) {
    let stream = TcpStream::connect(address).await.unwrap();
    stream.set_nodelay(true).unwrap();
    let (reads, mut writes) = stream.into_split();
    writes.write_all(b"C\rS8\rO\r").await.unwrap();
    let (sender, receiver) = unbounded_channel();
    tokio::spawn(async move {
        let mut lines = BufReader::new(reads).split(b'\r');
        while let Ok(Some(line)) = lines.next_segment().await {
            if let Some(message) = message(&line)
                && sender.send(message).is_err()
            {
                return;
            }
        }
    });
    (Sender(writes), Receiver(receiver))
}

fn message(line: &[u8]) -> Option<CanMessage> {
    let line = std::str::from_utf8(line).ok()?.strip_prefix('t')?;
    let id = u16::from_str_radix(line.get(..3)?, 16).ok()?;
    let digits = line.get(4..)?;
    let byte = |at: usize| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok();
    let data: Option<Vec<u8>> = (0..digits.len()).step_by(2).map(byte).collect();
    Some(CanMessage::new(CanId::std(id), &data?))
}

impl CanSendError for NotSent {
    fn into_can_message(self) -> CanMessage {
        self.0
    }
    fn message(&self) -> String {
        "the connection has ended".into()
    }
}

impl AsyncCanSender for Sender {
    type Error = NotSent;

    async fn send(&mut self, message: CanMessage) -> Result<(), NotSent> {
        let CanId::Std(id) = message.id() else { return Err(NotSent(message)) };
        let data: String = message.data().iter().map(|byte| format!("{byte:02X}")).collect();
        let line = format!("t{id:03X}{}{data}\r", message.data().len());
        self.0.write_all(line.as_bytes()).await.map_err(|_| NotSent(message))
    }
}

impl AsyncCanReceiver for Receiver {
    type Error = Ended;

    fn try_recv(&mut self) -> Option<CanMessage> {
        self.0.try_recv().ok()
    }

    async fn recv(&mut self) -> Result<CanMessage, Ended> {
        self.0.recv().await.ok_or(Ended)
    }
}
