//! `linkwatch repair`: rewrites a recording that was cut off.

use super::Outcome;
use super::files::{Content, Files, Overwrite, write_whole};
use super::input;
use super::output::{self, count, plural};
use linkwatch::{
    Ending, Error, FrameInfo, FrameRecord, RecordedFrame, RecordedItem, RecordedVerdict,
    RecordingReader, RecordingSink, Result, Sink,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// Rewrite a recording that was cut off, by a kill or a full disk, with all of its complete frames
///
/// Other tools then open it: a recording that was cut off has no index, and may end within a frame.
/// `linkwatch replay` reads it without a repair. Messages for other tools (`--record-for`) are
/// written again from the frames; topics of other programs are left out.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The recording
    #[arg(value_name = "IN.mcap")]
    input: PathBuf,
    /// The repaired recording
    #[arg(value_name = "OUT.mcap")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Frames of a recording.
#[derive(Default)]
struct Copied {
    frames: u64,
    /// Frames without a verdict, and verdicts without their frame.
    left_out: u64,
    /// Messages of other programs, which are not copied.
    foreign: u64,
    /// Frames that the recorder left out on purpose.
    not_recorded: u64,
    ending: Option<Ending>,
    /// Reason why the recording is read no further.
    damaged: Option<Error>,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let mut files = Files::new(args.overwrite);
    files.reads(&args.input);
    files.writes("OUT.mcap", &args.output, Content::Recording)?;
    if !input::is_recording(&args.input)? {
        return Err(Error::Usage(format!(
            "{}: not a recording of linkwatch: all messages are those of other programs \
             (`linkwatch convert` reads their curves)",
            args.input.display()
        )));
    }
    let mut copied = Copied::default();
    write_whole(&args.output, args.overwrite, |path| {
        copied = copy(&args.input, path)?;
        Ok(())
    })?;
    let input = args.input.display();
    let what = match (&copied.damaged, &copied.ending) {
        (Some(why), _) => format!("{input} is damaged: {why}"),
        (None, Some(Ending::Cut { at, what })) => {
            format!("{input} was cut off at byte {}, in {what}", count(*at))
        }
        _ => format!("{input} was complete"),
    };
    if json {
        output::json(&serde_json::json!({
            "input": args.input,
            "output": args.output,
            "frames": copied.frames,
            "left_out": copied.left_out,
            "left_out_messages": copied.foreign,
            "damaged": copied.damaged.as_ref().map(Error::to_string),
            "cut": matches!(copied.ending, Some(Ending::Cut { .. })),
        }));
    } else {
        let frames = plural(copied.frames, "frame");
        output::line(format_args!("{}: {frames}; {what}", args.output.display()));
        if copied.left_out > 0 {
            let frames = plural(copied.left_out, "frame");
            output::line(format_args!("  left out: {frames} without a verdict"));
        }
        if copied.foreign > 0 {
            let messages = plural(copied.foreign, "message");
            output::line(format_args!("  left out: {messages} of other programs"));
        }
    }
    Ok(match copied.damaged {
        Some(_) => Outcome::Undecided,
        None => Outcome::Fine,
    })
}

/// Copies all complete frames of a recording to a new one.
fn copy(from: &Path, to: &Path) -> Result<Copied> {
    let in_recording = |e: Error| e.in_file(from);
    let mut reader = RecordingReader::open(from).map_err(in_recording)?;
    let mut copied = Copied::default();
    // The metadata is complete once the first item was read.
    let mut next = reader.next_item();
    let mut metadata = reader.metadata().clone();
    metadata.insert("repaired_from".into(), from.display().to_string());
    // Messages for other tools are not copied but written again from the frames.
    let sink = RecordingSink::create(to, &metadata)?;
    let mut sink = Box::new(sink.with_tools(reader.tools())?);
    let mut waiting = None;
    loop {
        match next {
            Ok(Some(RecordedItem::Baseline(baseline))) => sink.begin(&baseline)?,
            Ok(Some(RecordedItem::Frame(frame))) => {
                copied.left_out += u64::from(waiting.replace(frame).is_some());
            }
            Ok(Some(RecordedItem::Verdict(verdict))) => {
                let seq = verdict.report.seq;
                let left_out = verdict.progress.left_out;
                sink.leave_out(left_out.saturating_sub(copied.not_recorded));
                copied.not_recorded = left_out;
                let frame = waiting.take_if(|frame| frame.seq == seq);
                sink.frame(&record(*verdict, frame).map_err(in_recording)?)?;
                copied.frames += 1;
            }
            Ok(None) => break,
            Err(why) => {
                copied.damaged = Some(why);
                break;
            }
        }
        next = reader.next_item();
    }
    copied.left_out += u64::from(waiting.is_some());
    copied.ending = reader.ending().cloned();
    copied.foreign = reader.skipped();
    sink.finish()?;
    Ok(copied)
}

/// Returns what was recorded about a frame.
fn record(verdict: RecordedVerdict, frame: Option<RecordedFrame>) -> Result<FrameRecord> {
    let RecordedVerdict { report, progress } = verdict;
    let mut curves = None;
    let mut info = FrameInfo::default();
    if let Some(frame) = frame {
        frame.ingest(&mut curves)?;
        info = frame.info;
    }
    Ok(FrameRecord {
        curves: curves.map(Arc::new),
        info,
        report: Arc::new(report),
        verified: progress.verified,
        skipped: progress.skipped,
        rejected: progress.rejected,
        recovered: progress.recovered,
        accepted: progress.accepted,
        times: progress.times,
        work: progress.work,
        received: SystemTime::UNIX_EPOCH + Duration::from_nanos(progress.received_ns),
    })
}
