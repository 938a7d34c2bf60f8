//! The conformance program: ENDPOINT TOKEN stream FILE [PROGRAM] | cancel FILE | watch N | jog AXIS VELOCITY MS | estop |
//! bench FILE; JSON on standard output, one object a line. Zenoh has no token: it is taken and not used.

use std::cell::Cell;
use std::time::{Duration, Instant};

use mcclient::{
    ConnectOptions, Continuation, ContinueRequest, EmergencyStop, Error, Machine, OnDisconnect, OpenRequest,
    Result,
};
use serde_json::{Value, json};

const CONFIRMED_WITHIN: Duration = Duration::from_secs(5);
/// A server that is killed needs so long at most to be there again.
const PATIENCE: Duration = Duration::from_secs(120);
const STATUS_CALLS: usize = 300;
const BENCH: Duration = Duration::from_secs(3);

#[tokio::main]
async fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [endpoint, _token, task, rest @ ..] = arguments.as_slice() else {
        eprintln!(
            "usage: conformance ENDPOINT TOKEN stream FILE [PROGRAM] | watch N | jog AXIS VELOCITY MS | estop"
        );
        std::process::exit(2);
    };
    let options = ConnectOptions::new().endpoint(endpoint).patience(PATIENCE);
    if let Err(error) = run(options, task, rest).await {
        say(&complaint(&error));
        std::process::exit(1);
    }
}

fn say(value: &Value) {
    println!("{value}");
}

fn complaint(error: &Error) -> Value {
    let about = error.program();
    let detail = |name: &str| error.problem().details.get(name).cloned().unwrap_or_default();
    json!({"code": error.code(), "message": error.message(), "hint": error.hint(), "diagnostics": error.diagnostics(),
        "accepted": about.map_or_else(|| detail("accepted"), |about| json!(about.accepted)),
        "done": about.map_or_else(|| detail("done"), |about| json!(about.done))})
}

async fn run(options: ConnectOptions, task: &str, rest: &[String]) -> Result<()> {
    if task == "estop" {
        let button = EmergencyStop::connect(&options).await?;
        button.press("conformance", CONFIRMED_WITHIN).await?;
        button.close().await;
    }
    let machine = options.connect().await?;
    match (task, rest) {
        ("stream", [file]) => stream(&machine, file, None).await?,
        ("stream", [file, program]) => stream(&machine, file, Some(program)).await?,
        ("cancel", [file]) => cancel(&machine, file).await?,
        ("bench", [file]) => bench(&machine, file).await?,
        ("watch", [rows]) => watch(&machine, number(rows)).await?,
        ("jog", [axis, velocity, milliseconds]) => {
            let velocity: f64 = velocity.parse().expect("a velocity");
            let jog = machine.jog_held(number(axis), velocity, None).await?;
            tokio::time::sleep(Duration::from_millis(number(milliseconds))).await;
            jog.stop().await?;
            say(&json!({"ok": true}));
        }
        ("estop", []) => say(&json!({"state": machine.status().await?.state})),
        _ => {
            eprintln!("no such task: {task} {rest:?}");
            std::process::exit(2);
        }
    }
    machine.close().await;
    Ok(())
}

fn number(text: &str) -> u64 {
    text.parse().expect("a number")
}

async fn stream(machine: &Machine, file: &str, former: Option<&str>) -> Result<()> {
    let text = std::fs::read_to_string(file).expect("a file that can be read");
    let program = if let Some(former) = former {
        let request = ContinueRequest {
            way: true,
            on_disconnect: OnDisconnect::Finish,
            ..ContinueRequest::new(former)
        };
        machine.continue_program(&request, show).await?
    } else {
        let options = OpenRequest {
            name: file.to_owned(),
            on_disconnect: OnDisconnect::Finish,
            ..OpenRequest::default()
        };
        machine.program(options).await?
    };
    say(&json!({"program": program.id()}));
    let known = usize::try_from(program.given_through()).expect("a line of the file");
    let mut rest = text.lines().filter(|line| !line.is_empty()).skip(known).peekable();
    if rest.peek().is_some() {
        program.send_lines(rest).await?;
    }
    let result = program.finish().await?;
    say(&json!({"state": program.state(), "accepted": result.accepted, "done": result.done}));
    Ok(())
}

#[allow(clippy::unnecessary_wraps, reason = "it could refuse to go on")]
fn show(shown: &Continuation) -> Result<()> {
    say(&json!({"continuation": {"line": shown.line, "done": shown.done, "axes": shown.axes.len()}}));
    Ok(())
}

/// Streams a file over and over, gives that up in the middle, and goes on with one line.
async fn cancel(machine: &Machine, file: &str) -> Result<()> {
    let text = std::fs::read_to_string(file).expect("a file that can be read");
    let lines: Vec<&str> = text.lines().collect();
    let last = *lines.last().expect("a line");
    let program = machine.program(OpenRequest::default()).await?;
    let fed = Cell::new(0_usize);
    let endless = std::iter::repeat_with(|| {
        fed.set(fed.get() + 1);
        *lines.get(fed.get() - 1).unwrap_or(&last)
    });
    tokio::select! {
        ended = program.send_lines(endless) => { ended?; }
        done = program.wait_done(lines.len() as u64) => done?,
    }
    let next = program.send(last).await?;
    let before = fed.get();
    let result = program.finish().await?;
    say(
        &json!({"next": next, "fed": before, "fed_later": fed.get() - before, "accepted": result.accepted,
        "done": result.done}),
    );
    Ok(())
}

async fn watch(machine: &Machine, rows: u64) -> Result<()> {
    let mut feed = machine.samples().await?;
    let (mut seen, mut gaps, mut axes, mut next) = (0, 0, 0, None);
    while seen < rows {
        let Some(samples) = feed.next().await else { break };
        gaps += u64::from(next.is_some_and(|next| next != samples.seq));
        next = Some(samples.seq + samples.rows as u64);
        seen += samples.rows as u64;
        axes = samples.axes.len();
    }
    say(&json!({"rows": seen, "gaps": gaps, "axes": axes}));
    Ok(())
}

#[allow(clippy::cast_precision_loss, reason = "figures for people")]
async fn bench(machine: &Machine, file: &str) -> Result<()> {
    let text = std::fs::read_to_string(file).expect("a file that can be read");
    let program = machine.program(OpenRequest::default()).await?;
    let begun = Instant::now();
    let count = program.send_lines(text.lines()).await?;
    let streamed = begun.elapsed().as_secs_f64();
    program.finish().await?;
    let mut latencies = Vec::with_capacity(STATUS_CALLS);
    for _ in 0..STATUS_CALLS {
        let begun = Instant::now();
        machine.status().await?;
        latencies.push(begun.elapsed().as_secs_f64());
    }
    latencies.sort_by(f64::total_cmp);
    let (mut frames, mut rows) = (0_u32, 0);
    let begun = Instant::now();
    let mut feed = machine.samples().await?;
    while begun.elapsed() < BENCH {
        let Some(samples) = feed.next().await else { break };
        frames += 1;
        rows += samples.rows;
    }
    let took = begun.elapsed().as_secs_f64();
    say(
        &json!({"lines_per_s": count as f64 / streamed, "status_p50_ms": 1e3 * latencies[STATUS_CALLS / 2],
        "frames_per_s": f64::from(frames) / took, "rows_per_s": rows as f64 / took}),
    );
    Ok(())
}
