//! A head on a board that has failed its self-test.

use crate::rig::{Host, MS};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::self_test::SelfTest;
use edm_servo_head::head::{Fault, State};

#[test]
fn it_says_what_has_failed_and_nothing_enables_it() {
    for (found, bits) in [(SelfTest::UNSEALED, 1), (SelfTest::DAMAGED, 2)] {
        let mut host = Host::found(found, 1);
        host.hear();
        assert!(host.emergencies.contains(&0xFF10), "{:x?}", host.emergencies);
        assert_eq!(host.read(0x2009, 3), bits);
        // A reset, and then the way to enable; and the same the other way round.
        for word in [0x80, 0x06, 0x07, 0x0F, 0x80, 0x00, 0x80] {
            host.write(0x6040, 0, 2, word);
            host.run(20 * MS);
            let status = host.head.status();
            assert_eq!((status.state, status.fault, status.closed), (State::Fault, Some(Fault::SelfTestFailed), false));
            assert_eq!(host.head.drive(), Drive::Coast);
        }
        // Why not, as any other fault whose cause is still there.
        assert_eq!(host.read(0x2000, 4), 8);
        assert!(!host.head.live().circuit.enables());
    }
}

#[test]
fn one_that_has_passed_is_enabled() {
    let mut host = Host::found(SelfTest::PASSED, 1);
    assert_eq!(host.read(0x2009, 3), 0);
    host.enable();
    host.run(10 * MS);
    assert_eq!((host.head.status().state, host.head.status().fault), (State::Ready, None));
}
