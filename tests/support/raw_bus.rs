//! The bus without the code of the crate: structs and ports written from `docs/reference/bus.md`,
//! send what no client of the crate would send.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::*;

/// Copy of the crate's header, which checks its layout independently.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[type_name("linkwatch.FrameHeader")]
pub struct Header {
    pub magic: u64,
    pub version: u32,
    pub flags: u32,
    pub session: u64,
    pub seq: u64,
    pub baseline: u64,
    pub time: f64,
    pub n_points: u64,
    pub n_curves: u32,
    pub basis: u32,
    pub coordinate_bytes: u32,
    pub cuts: u32,
    pub layout: u32,
    pub names_bytes: u32,
    pub time_step: f64,
    pub cell_vectors: u32,
    pub reserved: u32,
    pub cell_origin: [f64; 3],
    pub cell: [f64; 9],
}

impl Header {
    /// Value of `magic`.
    pub const MAGIC: u64 = u64::from_le_bytes(*b"LWFRAME\0");
    /// Value of `version`.
    pub const VERSION: u32 = 8;
    pub const END: u32 = 2;
    pub const ANNOUNCE: u32 = 4;
    pub const RADII: u32 = 16;
    pub const BASELINE: u32 = 32;
}

/// Copy of the crate's message of a watcher.
#[repr(C)]
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[type_name("linkwatch.Verdict")]
pub struct Message {
    pub magic: u64,
    pub version: u32,
    pub kind: u32,
    pub session: u64,
    pub seq: u64,
    pub time: f64,
    pub verdict: u32,
    pub abort: u32,
    pub lost: u32,
    pub gained: u32,
    pub changed: u32,
    pub defects: u32,
    pub events: u32,
    pub finding: u32,
    pub i: u32,
    pub j: u32,
    pub defect_kind: u32,
    pub segments: [u32; 2],
    pub has_place: u32,
    pub reason_len: u32,
    pub unresolved: u32,
    pub appeared: u32,
    pub gone: u32,
    pub findings: u32,
    pub recovered: u32,
    pub expected: i64,
    pub found: i64,
    pub point: [f64; 3],
    pub distance: f64,
    pub lengths: f64,
    pub extent: f64,
    pub verified: u64,
    pub skipped: u64,
    pub rejected: u64,
    pub check_ns: u64,
    pub last_intact: u64,
    pub safe_fraction: f64,
    pub image: [i32; 3],
    pub reason: [u8; 180],
}

impl Message {
    /// Value of `magic`.
    pub const MAGIC: u64 = u64::from_le_bytes(*b"LWVERDI\0");
}

/// Publisher of frames that joins like a bridge, without the lock of the crate's client.
pub struct RawSimulator {
    publisher: Publisher<ipc::Service, [u8], Header>,
    _node: Node<ipc::Service>,
}

impl RawSimulator {
    /// Opens the service that a watcher created.
    pub fn open(service: &str) -> RawSimulator {
        RawSimulator::on(&format!("{service}/frames"))
    }

    /// Opens a service with frames, by its whole name.
    pub fn on(name: &str) -> RawSimulator {
        let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
        let name = ServiceName::new(name).unwrap();
        let frames = node
            .service_builder(&name)
            .publish_subscribe::<[u8]>()
            .user_header::<Header>()
            .payload_alignment(Alignment::new(64).unwrap())
            .open()
            .unwrap();
        let publisher = frames
            .publisher_builder()
            .initial_max_slice_len(1 << 16)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .unwrap();
        RawSimulator {
            publisher,
            _node: node,
        }
    }

    /// Sends a frame. Returns the address of its payload in the memory of the sender, which stays
    /// mapped as long as the sender lives.
    pub fn send(&self, header: Header, payload: &[u8]) -> *mut u8 {
        let sample = self.publisher.loan_slice_uninit(payload.len()).unwrap();
        let mut sample = sample.write_from_slice(payload);
        *sample.user_header_mut() = header;
        let address = sample.payload_mut().as_mut_ptr();
        sample.send().unwrap();
        address
    }
}

/// Publisher of messages that joins like a bridge, without the lock of the crate's watcher.
pub struct RawWatcher {
    publisher: Publisher<ipc::Service, Message, ()>,
    _node: Node<ipc::Service>,
}

impl RawWatcher {
    /// Opens the service that a simulator created.
    pub fn open(service: &str) -> RawWatcher {
        let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
        let name = ServiceName::new(&format!("{service}/verdicts")).unwrap();
        let verdicts = node
            .service_builder(&name)
            .publish_subscribe::<Message>()
            .open()
            .unwrap();
        let publisher = verdicts
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .unwrap();
        RawWatcher {
            publisher,
            _node: node,
        }
    }

    pub fn send(&self, message: Message) {
        self.publisher.send_copy(message).unwrap();
    }
}
