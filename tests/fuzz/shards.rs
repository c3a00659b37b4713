//! Messages between watchers that share a scene. Their content is not part of the contract, so real
//! messages are recorded, changed and sent again.

use super::bytes::changed;
use super::memory::peak;
use super::support::raw_bus::{Header, RawSimulator};
use super::{service, units};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use linkwatch::scenes::Scene;
use linkwatch::{
    Certificate, CurveSet, Events, FrameInfo, Joiner, Link, Part, Partition, ShardEvent,
    ShardLeader, ShardMember, ShardSetup, Verdict, Verifier, VerifierOptions,
};
use std::time::Duration;

/// Number of the frame that is verified.
const SEQ: u64 = 5;
/// Maximum number of bytes that a process may allocate for a message of some kilobytes.
const MEMORY: usize = 4 << 20;
/// Limit of a wait for a message that is on its way.
const PATIENCE: Duration = Duration::from_secs(60);

/// Reads all messages of a service.
struct Tap {
    subscriber: Subscriber<ipc::Service, [u8], Header>,
    _node: Node<ipc::Service>,
}

impl Tap {
    fn on(name: &str) -> Tap {
        let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
        let topic = node
            .service_builder(&ServiceName::new(name).unwrap())
            .publish_subscribe::<[u8]>()
            .user_header::<Header>()
            .payload_alignment(Alignment::new(64).unwrap())
            .open()
            .unwrap();
        let subscriber = topic.subscriber_builder().create().unwrap();
        Tap {
            subscriber,
            _node: node,
        }
    }

    /// Returns the messages since the last call.
    fn read(&self) -> Vec<Message> {
        let next = || self.subscriber.receive().expect("receive");
        std::iter::from_fn(next)
            .map(|sample| (*sample.user_header(), sample.payload().to_vec()))
            .collect()
    }
}

type Message = (Header, Vec<u8>);

/// A leader and a member that have verified a frame together, and what they sent.
struct Pair {
    leader: ShardLeader,
    member: ShardMember,
    /// Message to begin, and the frame.
    tasks: [Message; 2],
    /// State with the result of the frame.
    state: Message,
    /// The same, of a member that leaves.
    leaving: Message,
    to_member: RawSimulator,
    to_leader: RawSimulator,
}

/// A scene, and expected numbers that differ from its own, so that a result has findings.
struct Shared {
    set: CurveSet,
    partition: Partition,
    options: VerifierOptions,
}

impl Shared {
    fn new() -> Shared {
        let built = "chainmail:rows=3,columns=3".parse::<Scene>();
        let set = built.unwrap().build().unwrap().curves;
        let mut verifier = Verifier::default();
        let (certificate, _) = verifier.certify(&set);
        let mut baseline = certificate.clone();
        baseline
            .links
            .iter_mut()
            .step_by(2)
            .for_each(|l| l.lambda += 1);
        let options = VerifierOptions {
            baseline: Some(baseline),
            events: Events::Off,
            ..VerifierOptions::default()
        };
        Shared {
            partition: Partition::new(&set, 2).unwrap(),
            set,
            options,
        }
    }

    fn setup(&self) -> ShardSetup {
        ShardSetup::new(&self.options, &self.partition)
    }

    /// Returns the result of one shard, from 0.
    fn part(&self, setup: ShardSetup, shard: usize) -> linkwatch::Result<Part> {
        let mut verifier = setup.verifier(VerifierOptions::default(), shard)?;
        let report = verifier.step(SEQ, 0.0, &self.set)?;
        Ok(verifier.part(report))
    }

    fn publish(&self, leader: &mut ShardLeader) {
        leader.begin(|_| Ok(self.setup())).expect("begin");
        let sent = leader.publish(SEQ, 0.0, &FrameInfo::default(), &self.set);
        sent.expect("publish");
    }

    /// Lets a leader and a member verify a frame.
    fn pair(&self) -> Pair {
        let name = service();
        let mut leader = ShardLeader::open(&name, 2).expect("leader");
        let mut member = ShardMember::open(&name, 2, 2).expect("member");
        let [tasks, states] = ["tasks", "states"].map(|part| format!("{name}/shards/{part}"));
        let (tasks_tap, states_tap) = (Tap::on(&tasks), Tap::on(&states));
        // The member says again that it is there, in case that the leader was not connected.
        while !leader.wait(Duration::ZERO).expect("wait").is_empty() {
            member.wait(Duration::from_millis(20)).expect("wait");
        }
        self.publish(&mut leader);
        let mut part = None;
        loop {
            match member.wait(PATIENCE).expect("wait") {
                ShardEvent::Begin(setup) => part = Some(self.part(setup, 1).expect("a part")),
                ShardEvent::Frame(frame) => {
                    assert_eq!(frame.seq(), SEQ);
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
        let tasks_sent = tasks_tap.read();
        states_tap.read();
        let part = part.expect("the member began");
        member.answer(SEQ, Ok(part)).expect("answer");
        let state = states_tap.read().pop().expect("a state");
        // The last field is the reason to leave: none, or a text with its length.
        let mut leaving = state.clone();
        assert_eq!(leaving.1.pop(), Some(0));
        leaving.1.extend(b"\x01\x06a test");
        let results = leader.collect(SEQ, || false).expect("collect");
        assert!(results[0].is_ok(), "{results:?}");
        let [begin, .., frame] = &tasks_sent[..] else {
            panic!("{} messages to the member", tasks_sent.len());
        };
        Pair {
            leader,
            member,
            tasks: [begin.clone(), frame.clone()],
            state,
            leaving,
            to_member: RawSimulator::on(&tasks),
            to_leader: RawSimulator::on(&states),
        }
    }
}

/// Joins the result of shard 2 with that of shard 1. Returns the verdict.
fn join(own: &Part, other: Result<Part, String>, curves: usize) -> Verdict {
    let mut joiner = Joiner::new(2, Events::Off);
    let missing = other.is_err();
    let report = joiner.join(SEQ, 0.0, vec![Ok(own.clone()), other]);
    assert!(!missing || report.verdict != Verdict::Intact);
    // Sinks use the curves of findings as indices.
    let steps = report.events.iter().chain(&report.unresolved);
    let pairs = (report.changes.iter().map(|c| (c.i, c.j)))
        .chain(steps.map(|e| (e.i, e.j)))
        .chain(report.defects.iter().map(|d| (d.i, d.j.unwrap_or(0))))
        .chain(report.adopted.iter().map(|l| (l.i, l.j)));
    let baseline = joiner.whole_baseline().unwrap_or_default();
    let pairs = pairs.chain(baseline.links.iter().map(|l| (l.i, l.j)));
    for (i, j) in pairs {
        assert!(i.max(j) < curves as u32, "curves {i} and {j} of {curves}");
    }
    // Whatever the numbers are, they can be printed.
    assert!(
        report
            .findings_named(&[])
            .all(|finding| !finding.is_empty())
    );
    report.verdict
}

#[test]
fn messages_of_a_member() {
    let shared = Shared::new();
    let own = shared.part(shared.setup(), 0).expect("a part");
    let mut pair = shared.pair();
    let (mut taken, mut missing, mut opened) = (0, 0, 0);
    units("shards::messages_of_a_member", 4000, |random| {
        shared.publish(&mut pair.leader);
        let (header, bytes) = match random.one_in(10) {
            true => &pair.leaving,
            false => &pair.state,
        };
        pair.to_leader.send(*header, &changed(bytes, random));
        let (results, most) = peak(|| pair.leader.collect(SEQ, || true).expect("collect"));
        assert!(most <= MEMORY, "{most} bytes");
        for result in results {
            match &result {
                Ok(_) => taken += 1,
                Err(why) => {
                    assert!(!why.is_empty());
                    missing += 1;
                }
            }
            join(&own, result, shared.set.len());
        }
        // The next good message is read, unless a changed one took the place of the member.
        let good = |pair: &mut Pair| {
            shared.publish(&mut pair.leader);
            pair.to_leader.send(pair.state.0, &pair.state.1);
            shared.publish(&mut pair.leader);
            pair.to_leader.send(pair.state.0, &pair.state.1);
            let results = pair.leader.collect(SEQ, || true).expect("collect");
            results.into_iter().next().expect("one member")
        };
        let mut result = good(&mut pair);
        if result.is_err() {
            pair = shared.pair();
            opened += 1;
            result = good(&mut pair);
        }
        assert!(result.is_ok(), "{result:?}");
        assert_eq!(join(&own, result, shared.set.len()), Verdict::Changed);
    });
    println!("shards: {taken} results taken, {missing} missing, {opened} places taken");
    assert!(
        opened < 40,
        "a changed message often took the place: {opened}"
    );
}

#[test]
fn messages_of_a_leader() {
    let shared = Shared::new();
    let mut pair = shared.pair();
    let honest = shared.part(shared.setup(), 1).expect("a part");
    let (mut begun, mut refused, mut frames) = (0, 0, 0);
    units("shards::messages_of_a_leader", 4000, |random| {
        let (header, bytes) = random.pick(&[&pair.tasks[0], &pair.tasks[1]]);
        pair.to_member.send(*header, &changed(bytes, random));
        let mut read = || {
            let (event, most) = peak(|| pair.member.wait(Duration::ZERO).expect("wait"));
            assert!(most <= MEMORY, "{most} bytes");
            event
        };
        match read() {
            ShardEvent::Begin(setup) => match shared.part(setup, 1) {
                Ok(_) => begun += 1,
                Err(why) => {
                    assert!(!why.to_string().is_empty());
                    refused += 1;
                }
            },
            ShardEvent::Frame(frame) => {
                let mut set = None;
                if let Err(why) = frame.ingest(&mut set) {
                    assert!(!why.to_string().is_empty());
                }
                frames += 1;
            }
            _ => {}
        }
        // The next good message is read.
        let (header, bytes) = &pair.tasks[0];
        pair.to_member.send(*header, bytes);
        let event = loop {
            match pair.member.wait(PATIENCE).expect("wait") {
                ShardEvent::Begin(setup) => break setup,
                ShardEvent::Frame(_) | ShardEvent::Refused(_) | ShardEvent::End => {}
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(shared.part(event, 1).expect("a part"), honest);
    });
    println!("shards: {begun} began, {refused} refused, {frames} frames");
    assert!(refused > 0 && frames > 0);
}

/// A certificate of another process that has a curve which the scene does not have.
#[test]
fn a_member_refuses_expected_numbers_of_curves_that_are_not_there() {
    let shared = Shared::new();
    let refuses = |change: fn(&mut Certificate)| {
        let mut options = shared.options.clone();
        change(options.baseline.as_mut().expect("given above"));
        let setup = ShardSetup::new(&options, &shared.partition);
        let why = shared
            .part(setup, 1)
            .expect_err("not a baseline of the scene");
        why.to_string()
    };
    let why = refuses(|c| {
        c.links.push(Link {
            i: 3,
            j: 900,
            lambda: 1,
        });
    });
    assert!(why.contains("pair 3,900 of"), "{why}");
    let why = refuses(|c| c.links.reverse());
    assert!(why.contains("not sorted"), "{why}");
}
