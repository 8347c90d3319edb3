//! zencan-client, a CANopen master that knows nothing of this project, against virtual heads over slcan.
//!
//! `tests/hosts/run` starts these tests: they need the program `edm-sim`, which the variable EDM_SIM names.

mod server;
mod slcan;

use server::Server;
use std::time::Duration;
use tokio::time::sleep;
use zencan_client::common::NodeId;
use zencan_client::common::lss::LssState;
use zencan_client::common::nmt::NmtState;
use zencan_client::common::sdo::AbortCode;
use zencan_client::{BusManager, LssError, LssMaster, RawAbortCode, SdoClient, SdoClientError};

/// Time after which a test hangs.
const HANGS: Duration = Duration::from_secs(300);

async fn client(server: &Server, node: u8) -> SdoClient<slcan::Sender, slcan::Receiver> {
    let (sender, receiver) = slcan::open(&server.address).await;
    let mut client = SdoClient::new_std(node, sender, receiver);
    client.set_timeout(HANGS);
    client
}

fn refused(result: Result<(), SdoClientError>, code: AbortCode) {
    match result {
        Err(SdoClientError::ServerAbort { abort_code, .. }) => assert_eq!(abort_code, RawAbortCode::Valid(code)),
        other => panic!("{other:?} instead of {code:?}"),
    }
}

#[tokio::test]
async fn every_head_is_found_with_its_name_and_identity() {
    let server = Server::new(&["--nodes", "3", "--node-id", "20"]);
    let (sender, receiver) = slcan::open(&server.address).await;
    let mut bus = BusManager::new(sender, receiver);
    // zencan-client waits 150 ms for an answer, and a busy computer may take longer.
    let mut nodes = Vec::new();
    for _ in 0..100 {
        nodes = bus.scan_nodes().await.unwrap_or_default();
        if nodes.len() == 3 && nodes.iter().all(|node| node.identity.is_some() && node.software_version.is_some()) {
            break;
        }
    }
    assert_eq!(nodes.iter().map(|node| node.node_id).collect::<Vec<_>>(), [20, 21, 22]);
    for node in &nodes {
        assert!(node.device_name.as_ref().is_some_and(|name| name.contains("EDM")), "{node}");
        assert!(node.software_version.as_ref().is_some_and(|version| !version.is_empty()), "{node}");
    }
    let mut serials: Vec<u32> = nodes.iter().map(|node| node.identity.unwrap().serial).collect();
    serials.dedup();
    assert_eq!(serials.len(), 3, "each has a serial number of its own");
}

/// Time for all heads to answer a message of a scan. A scan waits so long 133 times, however early the answers come.
const PATIENCE: Duration = Duration::from_millis(30);

/// The serial number of a head that waits for a node-ID. An answer that comes too late makes a scan find none: the next one waits
/// twice as long.
async fn found(master: &mut LssMaster<slcan::Sender, slcan::Receiver>) -> u32 {
    let mut patience = PATIENCE;
    while patience < Duration::from_secs(3) {
        if let Some(identity) = master.fast_scan(patience).await {
            return identity.serial;
        }
        patience *= 2;
    }
    panic!("no head waits for a node-ID")
}

/// Asks until it is granted: zencan-client waits 50 ms for an answer, and a busy computer may take longer.
async fn insist(mut ask: impl AsyncFnMut() -> Result<(), LssError>) {
    let mut answer = Err(LssError::Timeout);
    for _ in 0..6000 {
        answer = ask().await;
        if !matches!(answer, Err(LssError::Timeout)) {
            break;
        }
    }
    answer.unwrap();
}

#[tokio::test]
async fn every_head_without_a_node_id_is_found_and_named_and_stays_so() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--nodes", "3", "--node-id", "255", "--store", folder.path().to_str().unwrap()];
    let mut serials = vec![];
    {
        let server = Server::new(&options);
        let (sender, receiver) = slcan::open(&server.address).await;
        let mut master = LssMaster::new(sender, receiver);
        for id in [31, 32, 33] {
            serials.push(found(&mut master).await);
            insist(async || master.set_node_id(NodeId::new(id).unwrap()).await).await;
            // 500 kbit/s; 800 cannot be.
            insist(async || master.set_baud_rate(0, 2).await).await;
            assert!(master.set_baud_rate(0, 1).await.is_err());
            insist(async || master.store_config().await).await;
            master.set_global_mode(LssState::Waiting).await;
        }
        assert!(master.fast_scan(PATIENCE).await.is_none());
    }
    let server = Server::new(&options);
    for (id, serial) in [31, 32, 33].into_iter().zip(serials) {
        assert_eq!(client(&server, id).await.read_identity().await.unwrap().serial, serial);
    }
}

#[tokio::test]
async fn values_are_read_whole_and_in_segments_and_a_transfer_that_is_left_hanging_is_forgotten() {
    let server = Server::new(&[]);
    let mut sdo = client(&server, 1).await;
    assert_eq!(sdo.read_u32(0x1000, 0).await.unwrap() & 0xFFFF, 402);
    let name = sdo.upload(0x1008, 0).await.unwrap();
    assert!(name.len() > 4, "longer than an expedited transfer");
    // zencan-client 0.0.5 takes the bit that says "length indicated" for part of the command, and leaves without an abort.
    assert_eq!(sdo.block_upload(0x1008, 0).await, Err(SdoClientError::MalformedResponse));
    assert_eq!(sdo.upload(0x1008, 0).await.unwrap(), name);
}

#[tokio::test]
async fn values_are_written_whole_and_in_blocks_and_refused_ones_change_nothing() {
    let server = Server::new(&[]);
    let mut sdo = client(&server, 1).await;
    sdo.write_u16(0x1017, 0, 200).await.unwrap();
    assert_eq!(sdo.read_u16(0x1017, 0).await.unwrap(), 200);
    sdo.block_download(0x1017, 0, &150u16.to_le_bytes()).await.unwrap();
    assert_eq!(sdo.read_u16(0x1017, 0).await.unwrap(), 150);

    refused(sdo.download(0x1017, 0, &[1]).await, AbortCode::DataTypeMismatchLengthLow);
    refused(sdo.download(0x1017, 0, &[1, 2, 3, 4]).await, AbortCode::DataTypeMismatchLengthHigh);
    refused(sdo.write_u32(0x1000, 0, 1).await, AbortCode::ReadOnly);
    refused(sdo.write_u32(0x5FFF, 0, 1).await, AbortCode::NoSuchObject);
    refused(sdo.write_u8(0x1018, 9, 1).await, AbortCode::NoSuchSubIndex);
    assert_eq!(sdo.read_u16(0x1017, 0).await.unwrap(), 150);
}

#[tokio::test]
async fn the_states_of_network_management_show_in_the_heartbeat() {
    let server = Server::new(&[]);
    let (sender, receiver) = slcan::open(&server.address).await;
    let mut bus = BusManager::new(sender, receiver);
    bus.sdo_client(1).set_timeout(HANGS);
    bus.sdo_client(1).write_u16(0x1017, 0, 20).await.unwrap();
    bus.nmt_start(1).await;
    state(&bus, NmtState::Operational).await;
    bus.nmt_stop(1).await;
    state(&bus, NmtState::Stopped).await;
    bus.nmt_start(1).await;
    state(&bus, NmtState::Operational).await;
    bus.nmt_reset_app(1).await;
    // After a reset there is no heartbeat but boot-up, until one is set.
    state(&bus, NmtState::Bootup).await;
    bus.sdo_client(1).write_u16(0x1017, 0, 20).await.unwrap();
    state(&bus, NmtState::PreOperational).await;
}

async fn state(bus: &BusManager<slcan::Sender>, wanted: NmtState) {
    for _ in 0..30_000 {
        if bus.node_list().await.iter().any(|node| node.node_id == 1 && node.nmt_state == Some(wanted)) {
            return;
        }
        sleep(Duration::from_millis(10)).await;
    }
    panic!("never {wanted:?}: {:?}", bus.node_list().await);
}

#[tokio::test]
async fn parameters_are_saved_and_are_there_after_a_power_cut() {
    let store = std::env::temp_dir().join(format!("edm-zencan-{}", std::process::id()));
    std::fs::create_dir_all(&store).unwrap();
    let folder = store.to_str().unwrap();
    {
        let server = Server::new(&["--store", folder]);
        let mut sdo = client(&server, 1).await;
        sdo.write_u16(0x1017, 0, 123).await.unwrap();
        // zencan-client 0.0.5 spells the signature backwards.
        refused(sdo.save_objects().await, AbortCode::CantStore);
        sdo.write_u32(0x1010, 1, u32::from_le_bytes(*b"save")).await.unwrap();
        sdo.write_u16(0x1017, 0, 456).await.unwrap();
        // The server is killed.
    }
    let server = Server::new(&["--store", folder]);
    assert_eq!(client(&server, 1).await.read_u16(0x1017, 0).await.unwrap(), 123);
    std::fs::remove_dir_all(&store).unwrap();
}

#[tokio::test]
async fn a_head_is_enabled_homed_and_moved_by_sdo_alone() {
    let server = Server::new(&[]);
    let mut sdo = client(&server, 1).await;
    for (control, status) in [(0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)] {
        sdo.write_u16(0x6040, 0, control).await.unwrap();
        status_shows(&mut sdo, 0x6F, status).await;
    }
    // Homing where it is.
    sdo.write_i8(0x6098, 0, 35).await.unwrap();
    sdo.write_i8(0x6060, 0, 6).await.unwrap();
    sdo.write_u16(0x6040, 0, 0x1F).await.unwrap();
    status_shows(&mut sdo, 0x3400, 0x1400).await;
    sdo.write_u16(0x6040, 0, 0x0F).await.unwrap();
    // Profile position.
    sdo.write_i8(0x6060, 0, 1).await.unwrap();
    sdo.write_u32(0x6081, 0, 20_000).await.unwrap();
    for target in [1200, -50, 400] {
        sdo.write_i32(0x607A, 0, target).await.unwrap();
        sdo.write_u16(0x6040, 0, 0x1F).await.unwrap();
        status_shows(&mut sdo, 0x1000, 0x1000).await;
        sdo.write_u16(0x6040, 0, 0x0F).await.unwrap();
        status_shows(&mut sdo, 0x1400, 0x0400).await;
        let position = sdo.read_i32(0x6064, 0).await.unwrap();
        // Above home is the end of the travel: the target is cut off there.
        assert!((position - target.max(0)).abs() <= 3, "{position} instead of {target}");
    }
    sdo.write_u16(0x6040, 0, 0).await.unwrap();
    status_shows(&mut sdo, 0x4F, 0x40).await;
}

async fn status_shows(sdo: &mut SdoClient<slcan::Sender, slcan::Receiver>, mask: u16, pattern: u16) {
    let mut word = 0;
    for _ in 0..30_000 {
        word = sdo.read_u16(0x6041, 0).await.unwrap();
        if word & mask == pattern {
            return;
        }
        sleep(Duration::from_millis(10)).await;
    }
    panic!("statusword {word:#06x} never shows {pattern:#06x}");
}
