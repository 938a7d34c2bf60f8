//! The messages that the peer speaks, as their packages define them for ROS 2 Jazzy; hiroz computes their hashes.

use std::sync::Arc;

use hiroz::dynamic::{FieldSchema, FieldType, MessageSchema, MessageSchemaTypeDescription};
use hiroz::entity::{TypeHash, TypeInfo};
use hiroz::msg::{SerdeCdrSerdes, ZMessage};
use hiroz::{MessageTypeInfo, action::ZAction};
use serde::{Deserialize, Serialize};

macro_rules! message {
    ($name:ident, $full:literal, $fields:tt) => {
        #[derive(Debug, Clone, Default, Serialize, Deserialize, MessageTypeInfo)]
        #[ros_msg(type_name = $full)]
        pub struct $name $fields

        impl ZMessage for $name {
            type Serdes = SerdeCdrSerdes<Self>;
        }
    };
}

// hiroz derives no descriptions of what belongs to actions: `Follow` has them
macro_rules! part {
    ($name:ident, $fields:tt) => {
        #[derive(Debug, Clone, Default, Serialize, Deserialize)]
        pub struct $name $fields

        impl ZMessage for $name {
            type Serdes = SerdeCdrSerdes<Self>;
        }
    };
}

message!(Time, "builtin_interfaces/msg/Time", { pub sec: i32, pub nanosec: u32 });
message!(Duration, "builtin_interfaces/msg/Duration", { pub sec: i32, pub nanosec: u32 });
message!(Header, "std_msgs/msg/Header", { pub stamp: Time, pub frame_id: String });
message!(Uuid, "unique_identifier_msgs/msg/UUID", { pub uuid: [u8; 16] });
message!(JointState, "sensor_msgs/msg/JointState", {
    pub header: Header, pub name: Vec<String>, pub position: Vec<f64>, pub velocity: Vec<f64>, pub effort: Vec<f64>,
});
message!(Vector3, "geometry_msgs/msg/Vector3", { pub x: f64, pub y: f64, pub z: f64 });
message!(Quaternion, "geometry_msgs/msg/Quaternion", { pub x: f64, pub y: f64, pub z: f64, pub w: f64 });
message!(Transform, "geometry_msgs/msg/Transform", { pub translation: Vector3, pub rotation: Quaternion });
message!(Twist, "geometry_msgs/msg/Twist", { pub linear: Vector3, pub angular: Vector3 });
message!(Point, "trajectory_msgs/msg/JointTrajectoryPoint", {
    pub positions: Vec<f64>, pub velocities: Vec<f64>, pub accelerations: Vec<f64>, pub effort: Vec<f64>, pub time_from_start: Duration,
});
message!(Trajectory, "trajectory_msgs/msg/JointTrajectory", {
    pub header: Header, pub joint_names: Vec<String>, pub points: Vec<Point>,
});
message!(MultiPoint, "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint", {
    pub transforms: Vec<Transform>, pub velocities: Vec<Twist>, pub accelerations: Vec<Twist>, pub time_from_start: Duration,
});
message!(MultiTrajectory, "trajectory_msgs/msg/MultiDOFJointTrajectory", {
    pub header: Header, pub joint_names: Vec<String>, pub points: Vec<MultiPoint>,
});
message!(Tolerance, "control_msgs/msg/JointTolerance", {
    pub name: String, pub position: f64, pub velocity: f64, pub acceleration: f64,
});
message!(ComponentTolerance, "control_msgs/msg/JointComponentTolerance", {
    pub joint_name: String, pub component: u16, pub position: f64, pub velocity: f64, pub acceleration: f64,
});
part!(Goal, {
    pub trajectory: Trajectory,
    pub multi_dof_trajectory: MultiTrajectory,
    pub path_tolerance: Vec<Tolerance>,
    pub component_path_tolerance: Vec<ComponentTolerance>,
    pub goal_tolerance: Vec<Tolerance>,
    pub component_goal_tolerance: Vec<ComponentTolerance>,
    pub goal_time_tolerance: Duration,
});
part!(Ended, { pub error_code: i32, pub error_string: String });
part!(Feedback, {
    pub header: Header,
    pub joint_names: Vec<String>,
    pub desired: Point,
    pub actual: Point,
    pub error: Point,
    pub multi_dof_joint_names: Vec<String>,
    pub multi_dof_desired: MultiPoint,
    pub multi_dof_actual: MultiPoint,
    pub multi_dof_error: MultiPoint,
});
message!(GoalInfo, "action_msgs/msg/GoalInfo", { pub goal_id: Uuid, pub stamp: Time });
message!(GoalStatus, "action_msgs/msg/GoalStatus", { pub goal_info: GoalInfo, pub status: i8 });
message!(GoalStatusArray, "action_msgs/msg/GoalStatusArray", { pub status_list: Vec<GoalStatus> });

pub const FOLLOW: &str = "control_msgs/action/FollowJointTrajectory";

/// The action, with the types of its services and topics as the generators of ROS make them.
pub struct Follow;

impl ZAction for Follow {
    type Goal = Goal;
    type Result = Ended;
    type Feedback = Feedback;

    fn name() -> &'static str {
        "follow_joint_trajectory"
    }

    fn send_goal_type_info() -> TypeInfo {
        let request = [("goal_id", of::<Uuid>()), ("goal", FieldType::Message(goal()))];
        let response = [("accepted", FieldType::Bool), ("stamp", of::<Time>())];
        service(&format!("{FOLLOW}_SendGoal"), &request, &response)
    }

    fn get_result_type_info() -> TypeInfo {
        let response = [
            ("status", FieldType::Int8),
            ("result", FieldType::Message(ended())),
        ];
        service(
            &format!("{FOLLOW}_GetResult"),
            &[("goal_id", of::<Uuid>())],
            &response,
        )
    }

    fn cancel_goal_type_info() -> TypeInfo {
        let response = [
            ("return_code", FieldType::Int8),
            ("goals_canceling", many::<GoalInfo>()),
        ];
        service(
            "action_msgs/srv/CancelGoal",
            &[("goal_info", of::<GoalInfo>())],
            &response,
        )
    }

    fn feedback_type_info() -> TypeInfo {
        let fields = [
            ("goal_id", of::<Uuid>()),
            ("feedback", FieldType::Message(feedback())),
        ];
        info(&schema(&format!("{FOLLOW}_FeedbackMessage"), &fields))
    }

    fn status_type_info() -> TypeInfo {
        info(&GoalStatusArray::message_schema().expect("derived"))
    }
}

fn goal() -> Arc<MessageSchema> {
    let fields = [
        ("trajectory", of::<Trajectory>()),
        ("multi_dof_trajectory", of::<MultiTrajectory>()),
        ("path_tolerance", many::<Tolerance>()),
        ("component_path_tolerance", many::<ComponentTolerance>()),
        ("goal_tolerance", many::<Tolerance>()),
        ("component_goal_tolerance", many::<ComponentTolerance>()),
        ("goal_time_tolerance", of::<Duration>()),
    ];
    schema(&format!("{FOLLOW}_Goal"), &fields)
}

fn ended() -> Arc<MessageSchema> {
    let fields = [
        ("error_code", FieldType::Int32),
        ("error_string", FieldType::String),
    ];
    schema(&format!("{FOLLOW}_Result"), &fields)
}

fn feedback() -> Arc<MessageSchema> {
    let names = || FieldType::Sequence(Box::new(FieldType::String));
    let fields = [
        ("header", of::<Header>()),
        ("joint_names", names()),
        ("desired", of::<Point>()),
        ("actual", of::<Point>()),
        ("error", of::<Point>()),
        ("multi_dof_joint_names", names()),
        ("multi_dof_desired", of::<MultiPoint>()),
        ("multi_dof_actual", of::<MultiPoint>()),
        ("multi_dof_error", of::<MultiPoint>()),
    ];
    schema(&format!("{FOLLOW}_Feedback"), &fields)
}

fn many<T: MessageTypeInfo>() -> FieldType {
    FieldType::Sequence(Box::new(of::<T>()))
}

fn of<T: MessageTypeInfo>() -> FieldType {
    FieldType::Message(T::message_schema().expect("derived"))
}

/// The builder of descriptions refuses names of actions, the hash does not.
fn schema(name: &str, fields: &[(&str, FieldType)]) -> Arc<MessageSchema> {
    let (package, last) = (name.split('/').next(), name.split('/').next_back());
    Arc::new(MessageSchema {
        type_name: name.to_string(),
        package: package.unwrap_or_default().to_string(),
        name: last.unwrap_or_default().to_string(),
        fields: fields.iter().map(|(field, kind)| FieldSchema::new(*field, kind.clone())).collect(),
        type_hash: None,
    })
}

fn service(name: &str, request: &[(&str, FieldType)], response: &[(&str, FieldType)]) -> TypeInfo {
    let request = FieldType::Message(schema(&format!("{name}_Request"), request));
    let response = FieldType::Message(schema(&format!("{name}_Response"), response));
    let about = [
        ("event_type", FieldType::Uint8),
        ("stamp", of::<Time>()),
        ("client_gid", FieldType::Array(Box::new(FieldType::Uint8), 16)),
        ("sequence_number", FieldType::Int64),
    ];
    let event = [
        (
            "info",
            FieldType::Message(schema("service_msgs/msg/ServiceEventInfo", &about)),
        ),
        (
            "request",
            FieldType::BoundedSequence(Box::new(request.clone()), 1),
        ),
        (
            "response",
            FieldType::BoundedSequence(Box::new(response.clone()), 1),
        ),
    ];
    let event = FieldType::Message(schema(&format!("{name}_Event"), &event));
    let fields = [
        ("request_message", request),
        ("response_message", response),
        ("event_message", event),
    ];
    info(&schema(name, &fields))
}

fn info(schema: &MessageSchema) -> TypeInfo {
    let computed = schema.compute_type_hash().expect("a hash").to_rihs_string();
    let hash = TypeHash::from_rihs_string(&computed).expect("RIHS01");
    let (package, rest) = schema.type_name.split_once('/').expect("package/kind/Name");
    let (kind, name) = rest.split_once('/').expect("package/kind/Name");
    TypeInfo::new(&format!("{package}::{kind}::dds_::{name}_"), hash)
}
