//! A peer of ROS 2 that looks at `mcserver ros` and sends it goals; each command prints one JSON object.
//!
//! ```text
//! ros-peer ENDPOINT DOMAIN graph
//! ros-peer ENDPOINT DOMAIN listen SECONDS
//! ros-peer ENDPOINT DOMAIN goals COUNT SEED
//! ros-peer ENDPOINT DOMAIN leave SECONDS      a goal of so long, and then no more of this process
//! ```

mod types;

use std::error::Error;
use std::num::NonZeroUsize;
use std::time::{Duration as Span, Instant};

use hiroz::action::GoalStatus;
use hiroz::action::client::ZActionClient;
use hiroz::context::ZContextBuilder;
use hiroz::node::ZNode;
use hiroz::qos::{QosHistory, QosProfile};
use hiroz::{Builder, ServiceTypeInfo};
use serde_json::{Value, json};
use types::{Duration, Follow, Goal, JointState, Point, Trajectory};

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

const ACTION: &str = "/joint_trajectory_controller/follow_joint_trajectory";
const LIMIT: Span = Span::from_secs(30);

#[tokio::main]
async fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [endpoint, domain, command, rest @ ..] = words.as_slice() else {
        return Err("ENDPOINT DOMAIN COMMAND ...".into());
    };
    let context = ZContextBuilder::default()
        .disable_multicast_scouting()
        .with_mode("client")
        .with_connect_endpoints([endpoint.as_str()])
        .with_domain_id(domain.parse()?)
        .build()?;
    let node = context.create_node("peer").without_parameters().build()?;
    let number = |at: usize| {
        rest.get(at)
            .ok_or("a number is missing")?
            .parse::<u64>()
            .map_err(Box::<dyn Error + Send + Sync>::from)
    };
    let said = match command.as_str() {
        "graph" => graph(&node).await?,
        "listen" => listen(&node, Span::from_secs(number(0)?)).await?,
        "goals" => goals(&node, number(0)?, number(1)?).await?,
        "leave" => leave(&node, number(0)?).await?,
        other => return Err(format!("no command {other}").into()),
    };
    println!("{said}");
    Ok(())
}

async fn graph(node: &ZNode) -> Outcome<Value> {
    let graph = node.graph();
    graph.wait_for_external_settled(&[node.session().zid()], Span::from_millis(500), LIMIT).await;
    let mut nodes = graph.get_node_names();
    let mut topics = graph.get_topic_names_and_types();
    let mut services = graph.get_service_names_and_types();
    let mut actions = graph.get_action_names_and_types();
    nodes.sort();
    topics.sort();
    services.sort();
    actions.sort();
    Ok(json!({"nodes": nodes, "topics": topics, "services": services, "actions": actions}))
}

async fn listen(node: &ZNode, span: Span) -> Outcome<Value> {
    // a second of them: what this process is late for is not what the network has lost
    let deep = QosProfile {
        history: QosHistory::KeepLast(NonZeroUsize::new(1000).expect("1000")),
        ..QosProfile::default()
    };
    let states = node.create_sub::<JointState>("/joint_states").with_qos(deep).build()?;
    let first = states.recv_timeout(LIMIT)?;
    let begin = Instant::now();
    let (mut count, mut backwards, mut longest, mut last) = (0_u64, 0_u64, 0.0_f64, stamp(&first));
    let start = last;
    while begin.elapsed() < span {
        let state = states.recv_timeout(LIMIT)?;
        let now = stamp(&state);
        count += 1;
        backwards += u64::from(now <= last);
        longest = longest.max(now - last);
        last = now;
    }
    let seconds = begin.elapsed().as_secs_f64();
    Ok(json!({
        "messages": count, "seconds": seconds, "hz": count as f64 / seconds,
        "hz_by_stamps": count as f64 / (last - start), "longest_gap_s": longest, "not_later": backwards,
        "names": first.name,
    }))
}

fn stamp(state: &JointState) -> f64 {
    f64::from(state.header.stamp.sec) + 1e-9 * f64::from(state.header.stamp.nanosec)
}

/// What is asked of a goal besides its way.
#[derive(Clone, Copy, PartialEq)]
enum Wish {
    Reach,
    Cancel,
    Preempt,
}

async fn client(node: &ZNode) -> Outcome<ZActionClient<Follow>> {
    let client = node.create_action_client::<Follow>(ACTION).build()?;
    if !client.wait_for_server(LIMIT).await {
        return Err("no action server".into());
    }
    Ok(client)
}

async fn goals(node: &ZNode, count: u64, seed: u64) -> Outcome<Value> {
    let client = client(node).await?;
    let mut random = Random(seed);
    let mut asked = [0_u64; 3];
    let mut as_asked = 0_u64;
    let mut feedbacks = 0_u64;
    let mut others: Vec<Value> = Vec::new();
    let mut pending = Vec::new();
    for at in 0..count {
        let last = at + 1 == count;
        let wish = match random.below(4) {
            _ if last => Wish::Reach,
            0 => Wish::Cancel,
            1 => Wish::Preempt,
            _ => Wish::Reach,
        };
        asked[wish as usize] += 1;
        // one that is to be stopped takes longer than it is left alone
        let takes = if wish == Wish::Reach {
            0.4 + 0.1 * random.below(4) as f64
        } else {
            2.5
        };
        let to = [0.2 * (random.share() - 0.5), 0.2 * (random.share() - 0.5)];
        let mut handle = client.send_goal(goal(to, takes)).await?;
        let mut feedback = handle.feedback().ok_or("no feedback")?;
        let status = handle.status_watch().ok_or("no status")?;
        match wish {
            Wish::Reach => {}
            Wish::Cancel => {
                tokio::time::sleep(Span::from_millis(50 + random.below(400))).await;
                let reply = handle.cancel().await?;
                if reply.return_code != 0 {
                    others.push(json!({"goal": at, "cancel": reply.return_code}));
                }
            }
            Wish::Preempt => {
                tokio::time::sleep(Span::from_millis(50 + random.below(400))).await;
                pending.push((at, wish, handle, status));
                continue;
            }
        }
        pending.push((at, wish, handle, status));
        for (at, wish, handle, mut status) in pending.drain(..) {
            let ended = tokio::time::timeout(LIMIT, handle.result()).await??;
            let found = tokio::time::timeout(LIMIT, status.wait_for(GoalStatus::is_terminal)).await;
            let found = found.map_or(Ok(GoalStatus::Unknown), |seen| seen.map(|each| *each))?;
            let wanted = match wish {
                Wish::Reach => (GoalStatus::Succeeded, 0),
                Wish::Cancel => (GoalStatus::Canceled, 0),
                Wish::Preempt => (GoalStatus::Canceled, -1),
            };
            if (found, ended.error_code) == wanted {
                as_asked += 1;
            } else {
                others.push(json!({
                    "goal": at, "status": format!("{found:?}"), "code": ended.error_code, "text": ended.error_string,
                }));
            }
        }
        while feedback.try_recv().is_ok() {
            feedbacks += 1;
        }
    }
    Ok(json!({
        "goals": count, "reach": asked[0], "cancel": asked[1], "preempt": asked[2],
        "as_asked": as_asked, "otherwise": others, "feedbacks_of_those_alone": feedbacks,
        "send_goal": <hiroz::action::messages::GoalService<Follow>>::service_type_info().hash.to_rihs_string(),
    }))
}

async fn leave(node: &ZNode, seconds: u64) -> Outcome<Value> {
    let client = client(node).await?;
    let handle = client.send_goal(goal([0.3, 0.1], seconds as f64)).await?;
    tokio::time::sleep(Span::from_millis(300)).await;
    println!("{}", json!({"goal": handle.id().to_string()}));
    // as one that is killed
    std::process::abort();
}

fn goal(to: [f64; 2], seconds: f64) -> Goal {
    let whole = seconds.floor();
    let point = Point {
        positions: to.to_vec(),
        velocities: vec![0.0; 2],
        accelerations: vec![0.0; 2],
        time_from_start: Duration {
            sec: whole as i32,
            nanosec: ((seconds - whole) * 1e9) as u32,
        },
        ..Point::default()
    };
    let names = ["joint_1", "joint_2"].map(String::from).to_vec();
    let trajectory = Trajectory {
        joint_names: names,
        points: vec![point],
        ..Trajectory::default()
    };
    Goal {
        trajectory,
        ..Goal::default()
    }
}

/// Numbers that a seed replays (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed ^ (mixed >> 31)) % bound
    }

    fn share(&mut self) -> f64 {
        self.below(1 << 20) as f64 / f64::from(1 << 20)
    }
}
