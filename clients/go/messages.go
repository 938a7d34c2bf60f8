package mcclient

// ProgramState is a state of a program. A later server may know further ones.
type ProgramState string

// The states that this version knows. The last five are ends.
const (
	Queued      ProgramState = "queued"
	Running     ProgramState = "running"
	Held        ProgramState = "held"
	Paused      ProgramState = "paused"
	Ending      ProgramState = "ending"
	Finished    ProgramState = "finished"
	Aborted     ProgramState = "aborted"
	Rejected    ProgramState = "rejected"
	Faulted     ProgramState = "faulted"
	Interrupted ProgramState = "interrupted"
)

// Ended tells whether a program in this state is over.
func (s ProgramState) Ended() bool {
	switch s {
	case Finished, Aborted, Rejected, Faulted, Interrupted:
		return true
	}
	return false
}

// Edit is a certain remedy: characters Column to EndColumn (exclusive, from 1) become Text.
type Edit struct {
	Column    int64  `msgpack:"column" mc:"required"`
	EndColumn int64  `msgpack:"end_column" mc:"required"`
	Text      string `msgpack:"text" mc:"required"`
}

// Diagnostic is one fault of a program, placed in its text; columns are code points from 1, the end exclusive.
type Diagnostic struct {
	Code       string   `msgpack:"code" mc:"required"`
	Message    string   `msgpack:"message" mc:"required"`
	Line       int64    `msgpack:"line"`
	Column     int64    `msgpack:"column"`
	EndColumn  int64    `msgpack:"end_column"`
	Hint       string   `msgpack:"hint"`
	Severity   string   `msgpack:"severity" mc:"default=error"`
	Tool       *int64   `msgpack:"tool"`
	ResidualMM *float64 `msgpack:"residual_mm"`
	Axis       *int64   `msgpack:"axis"`
	Edit       *Edit    `msgpack:"edit"`
}

// Fault is what stopped motion.
type Fault struct {
	Code    string  `msgpack:"code" mc:"required"`
	Message string  `msgpack:"message" mc:"required"`
	Hint    string  `msgpack:"hint"`
	Axis    *int64  `msgpack:"axis"`
	Line    int64   `msgpack:"line"`
	Program *string `msgpack:"program"`
	T       float64 `msgpack:"t"`
}

// Ack is a cumulative acknowledgement of a program's lines.
type Ack struct {
	Program     string       `msgpack:"program" mc:"required"`
	Accepted    int64        `msgpack:"accepted" mc:"required"`
	Done        int64        `msgpack:"done" mc:"required"`
	Credit      int64        `msgpack:"credit" mc:"required"`
	State       ProgramState `msgpack:"state" mc:"required"`
	Rejected    int64        `msgpack:"rejected"`
	Diagnostics []Diagnostic `msgpack:"diagnostics"`
	Fault       *Fault       `msgpack:"fault"`
	Expected    int64        `msgpack:"expected"`
	// Rejections of lines so far; an acknowledgement with a smaller count than one before is older.
	Rejections int64 `msgpack:"rejections"`
}

// ProgramStatus is one program as the server knows it; DurationS is known once its text was simulated; Progress and EtaS are by time then.
type ProgramStatus struct {
	Program     string       `msgpack:"program" mc:"required"`
	State       ProgramState `msgpack:"state" mc:"required"`
	Client      string       `msgpack:"client" mc:"required"`
	Name        string       `msgpack:"name" mc:"required"`
	Axes        []int64      `msgpack:"axes" mc:"required"`
	StartLine   int64        `msgpack:"start_line" mc:"required"`
	Line        int64        `msgpack:"line" mc:"required"`
	Accepted    int64        `msgpack:"accepted" mc:"required"`
	Done        int64        `msgpack:"done" mc:"required"`
	Credit      int64        `msgpack:"credit" mc:"required"`
	Closed      bool         `msgpack:"closed" mc:"required"`
	Override    float64      `msgpack:"override" mc:"required"`
	Progress    float64      `msgpack:"progress" mc:"required"`
	OpenedAt    float64      `msgpack:"opened_at" mc:"required"`
	EtaS        *float64     `msgpack:"eta_s"`
	Fault       *Fault       `msgpack:"fault"`
	Rejected    int64        `msgpack:"rejected"`
	Diagnostics []Diagnostic `msgpack:"diagnostics"`
	ResumeOf    *string      `msgpack:"resume_of"`
	EndedAt     *float64     `msgpack:"ended_at"`
	DurationS   *float64     `msgpack:"duration_s"`
	Notice      string       `msgpack:"notice"`
	Rejections  int64        `msgpack:"rejections"`
}

// AxesStatus has one entry for each of Index in every slice.
type AxesStatus struct {
	Index    []int64   `msgpack:"index" mc:"required"`
	Position []float64 `msgpack:"position" mc:"required"`
	Setpoint []float64 `msgpack:"setpoint" mc:"required"`
	Velocity []float64 `msgpack:"velocity" mc:"required"`
	Torque   []float64 `msgpack:"torque" mc:"required"`
	State    []string  `msgpack:"state" mc:"required"`
	Homed    []bool    `msgpack:"homed"`
}

// ToolPose is where a tool's frame is: x, y, z in mm, a, b, c in deg.
type ToolPose struct {
	Number      int64     `msgpack:"number" mc:"required"`
	Position    []float64 `msgpack:"position" mc:"required"`
	Orientation []float64 `msgpack:"orientation" mc:"required"`
}

// InputStatus is an input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now.
type InputStatus struct {
	Name  string  `msgpack:"name" mc:"required"`
	Value float64 `msgpack:"value" mc:"required"`
	Holds bool    `msgpack:"holds"`
	Stops bool    `msgpack:"stops"`
}

// OutputStatus is an output: its value, and who has set it last: a program's id, operator, or nobody (empty).
type OutputStatus struct {
	Name  string  `msgpack:"name" mc:"required"`
	Value float64 `msgpack:"value" mc:"required"`
	SetBy string  `msgpack:"set_by"`
}

// ProbeStatus is the last probing move that has ended: whether the probe changed, and where the axes were then, else
// where the move ended, by number [mm, deg].
type ProbeStatus struct {
	Program   string             `msgpack:"program" mc:"required"`
	Line      int64              `msgpack:"line" mc:"required"`
	Tripped   bool               `msgpack:"tripped" mc:"required"`
	Positions map[string]float64 `msgpack:"positions" mc:"required"`
	T         float64            `msgpack:"t" mc:"required"`
}

// MachineStatus is the whole machine; State is ready, fault or estop, the latter two latched until reset.
type MachineStatus struct {
	T          float64         `msgpack:"t" mc:"required"`
	Wall       float64         `msgpack:"wall" mc:"required"`
	Instance   string          `msgpack:"instance" mc:"required"`
	State      string          `msgpack:"state" mc:"required"`
	Axes       AxesStatus      `msgpack:"axes" mc:"required"`
	Programs   []ProgramStatus `msgpack:"programs" mc:"required"`
	Faults     []Fault         `msgpack:"faults" mc:"required"`
	Override   float64         `msgpack:"override" mc:"default=100"`
	LateCycles int64           `msgpack:"late_cycles"`
	Tools      []ToolPose      `msgpack:"tools"`
	Inputs     []InputStatus   `msgpack:"inputs"`
	Outputs    []OutputStatus  `msgpack:"outputs"`
	Probe      *ProbeStatus    `msgpack:"probe"`
	// WorkOffsets are the work coordinate systems that were set.
	WorkOffsets []WorkOffset `msgpack:"work_offsets"`
}

// WorkOffset is the origin of a work coordinate system such as G54, by axis number [mm, deg].
type WorkOffset struct {
	System string             `msgpack:"system" mc:"required"`
	Origin map[string]float64 `msgpack:"origin" mc:"required"`
}

// LineReport is the time of one line that has ended; StretchedBy is actual/requested, BoundBy the limit that bound it.
type LineReport struct {
	Line        int64    `msgpack:"line" mc:"required"`
	StartS      float64  `msgpack:"start_s" mc:"required"`
	EndS        float64  `msgpack:"end_s" mc:"required"`
	RequestedS  *float64 `msgpack:"requested_s"`
	StretchedBy *float64 `msgpack:"stretched_by"`
	BoundBy     *string  `msgpack:"bound_by"`
}

// Event is one event; Kind says which fields are set (docs/wire/events.md). A later server may know further kinds.
type Event struct {
	Seq         int64        `msgpack:"seq" mc:"required"`
	T           float64      `msgpack:"t" mc:"required"`
	Instance    string       `msgpack:"instance" mc:"required"`
	Kind        string       `msgpack:"kind" mc:"required"`
	Program     *string      `msgpack:"program"`
	Client      *string      `msgpack:"client"`
	State       *string      `msgpack:"state"`
	Line        int64        `msgpack:"line"`
	Lines       []LineReport `msgpack:"lines"`
	Fault       *Fault       `msgpack:"fault"`
	Diagnostics []Diagnostic `msgpack:"diagnostics"`
	Reason      string       `msgpack:"reason"`
	Message     string       `msgpack:"message"`
	Percent     *float64     `msgpack:"percent"`
	Axis        *int64       `msgpack:"axis"`
	Probe       *ProbeStatus `msgpack:"probe"`
}

// EventsReply is a page of events; Oldest is the first number that the server still has.
type EventsReply struct {
	Instance string  `msgpack:"instance" mc:"required"`
	Oldest   int64   `msgpack:"oldest" mc:"required"`
	Newest   int64   `msgpack:"newest" mc:"required"`
	Events   []Event `msgpack:"events" mc:"required"`
}

// AxisInfo is one axis; limits in mm or deg and seconds, nil where not limited.
type AxisInfo struct {
	Index           int64    `msgpack:"index" mc:"required"`
	Type            string   `msgpack:"type" mc:"required"`
	Unit            string   `msgpack:"unit" mc:"required"`
	MaxVelocity     float64  `msgpack:"max_velocity" mc:"required"`
	MaxAcceleration float64  `msgpack:"max_acceleration" mc:"required"`
	Drive           string   `msgpack:"drive" mc:"required"`
	MaxJerk         *float64 `msgpack:"max_jerk"`
	MinPosition     *float64 `msgpack:"min_position"`
	MaxPosition     *float64 `msgpack:"max_position"`
	InPosition      float64  `msgpack:"in_position"`
	Homing          *string  `msgpack:"homing"`
}

// InputInfo is one input: its number of its kind (digital, analog), where a real one comes from (empty: simulated),
// and what it can do.
type InputInfo struct {
	Name   string `msgpack:"name" mc:"required"`
	Number int64  `msgpack:"number" mc:"required"`
	Kind   string `msgpack:"kind" mc:"required"`
	Unit   string `msgpack:"unit"`
	Source string `msgpack:"source"`
	Hold   bool   `msgpack:"hold"`
	Stop   bool   `msgpack:"stop"`
}

// OutputInfo is one output; Safe is its value once what has set it is lost, nil: it stays.
type OutputInfo struct {
	Name   string   `msgpack:"name" mc:"required"`
	Number int64    `msgpack:"number" mc:"required"`
	Kind   string   `msgpack:"kind" mc:"required"`
	Unit   string   `msgpack:"unit"`
	Target string   `msgpack:"target"`
	Min    float64  `msgpack:"min"`
	Max    float64  `msgpack:"max" mc:"default=1"`
	Safe   *float64 `msgpack:"safe"`
}

// ToolInfo is one tool of G01 … Tn.
type ToolInfo struct {
	Number      int64   `msgpack:"number" mc:"required"`
	Frame       string  `msgpack:"frame" mc:"required"`
	Axes        []int64 `msgpack:"axes" mc:"required"`
	Orientation bool    `msgpack:"orientation" mc:"required"`
	Euler       string  `msgpack:"euler" mc:"required"`
}

// TelemetryInfo has the columns and fields of samples.
type TelemetryInfo struct {
	Axes           []int64  `msgpack:"axes" mc:"required"`
	Fields         []string `msgpack:"fields" mc:"required"`
	CyclesAMessage int64    `msgpack:"cycles_a_message" mc:"required"`
	StateHz        float64  `msgpack:"state_hz" mc:"required"`
}

// LimitsInfo has the bounds of the service.
type LimitsInfo struct {
	MaxLineLength     int64   `msgpack:"max_line_length" mc:"required"`
	MaxLinesAMessage  int64   `msgpack:"max_lines_a_message" mc:"required"`
	QueueLines        int64   `msgpack:"queue_lines" mc:"required"`
	ProgramsAtOnce    int64   `msgpack:"programs_at_once" mc:"required"`
	OpenPrograms      int64   `msgpack:"open_programs" mc:"required"`
	RememberedAnswers int64   `msgpack:"remembered_answers" mc:"required"`
	RememberedAnswerS float64 `msgpack:"remembered_answer_s" mc:"required"`
}

// Info describes the machine and the service; Instance is one start of the server, Epoch the Unix time of executor time 0.
type Info struct {
	Machine   string        `msgpack:"machine" mc:"required"`
	Server    string        `msgpack:"server" mc:"required"`
	Protocol  []int64       `msgpack:"protocol" mc:"required"`
	Instance  string        `msgpack:"instance" mc:"required"`
	Epoch     float64       `msgpack:"epoch" mc:"required"`
	CycleS    float64       `msgpack:"cycle_s" mc:"required"`
	Axes      []AxisInfo    `msgpack:"axes" mc:"required"`
	Tools     []ToolInfo    `msgpack:"tools" mc:"required"`
	Telemetry TelemetryInfo `msgpack:"telemetry" mc:"required"`
	Limits    LimitsInfo    `msgpack:"limits" mc:"required"`
	Methods   []string      `msgpack:"methods" mc:"required"`
	Inputs    []InputInfo   `msgpack:"inputs"`
	Outputs   []OutputInfo  `msgpack:"outputs"`
}

// CheckReply has every fault of a text; OK: there is no error among them.
type CheckReply struct {
	OK          bool         `msgpack:"ok" mc:"required"`
	Diagnostics []Diagnostic `msgpack:"diagnostics" mc:"required"`
}

// OpenReply is the answer to open.
type OpenReply struct {
	Program  string       `msgpack:"program" mc:"required"`
	State    ProgramState `msgpack:"state" mc:"required"`
	Axes     []int64      `msgpack:"axes" mc:"required"`
	Expected int64        `msgpack:"expected" mc:"required"`
	Credit   int64        `msgpack:"credit" mc:"required"`
	Instance string       `msgpack:"instance" mc:"required"`
}

// SubmitReply is the answer to submit, cumulative as Ack.
type SubmitReply struct {
	Program    string `msgpack:"program" mc:"required"`
	Accepted   int64  `msgpack:"accepted" mc:"required"`
	Done       int64  `msgpack:"done" mc:"required"`
	Credit     int64  `msgpack:"credit" mc:"required"`
	Rejections int64  `msgpack:"rejections"`
}

// CloseReply is the answer to close.
type CloseReply struct {
	Program  string       `msgpack:"program" mc:"required"`
	Accepted int64        `msgpack:"accepted" mc:"required"`
	Done     int64        `msgpack:"done" mc:"required"`
	State    ProgramState `msgpack:"state" mc:"required"`
}

// JogReply has the jog's program.
type JogReply struct {
	Program string `msgpack:"program" mc:"required"`
}

// ProgramsReply has programs, the newest first.
type ProgramsReply struct {
	Programs []ProgramStatus `msgpack:"programs" mc:"required"`
}

// ErrorReply is the payload of every error reply.
type ErrorReply struct {
	Code        string         `msgpack:"code" mc:"required"`
	Message     string         `msgpack:"message" mc:"required"`
	Hint        string         `msgpack:"hint"`
	Details     map[string]any `msgpack:"details"`
	Diagnostics []Diagnostic   `msgpack:"diagnostics"`
}
