//! A machine: the client's entrance.

use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::sync::OnceCell;

use crate::calls::{Caller, DEADLINE, Nothing, Trying};
use crate::connection::Connection;
use crate::core::Core;
use crate::discovery::{ConnectOptions, find_machine};
use crate::error::{Error, Problem, Result};
use crate::estop::{EmergencyStop, send_until_confirmed};
use crate::feed::Feed;
use crate::jog::{HeldJog, jog_held};
use crate::keys::{Keys, PROTOCOL_VERSION};
use crate::link::Link;
use crate::messages::{
    Continuation, ContinuationRequest, ContinueRequest, Event, Info, MachineStatus, OpenRequest,
};
use crate::presence::{Presence, lock};
use crate::program::Program;
use crate::stream::LineStream;
use crate::telemetry::{Samples, decode_samples};
use crate::window::Bounds;
use crate::wire::decode;

const LEAVE: Duration = Duration::from_secs(1);
/// Of a program's name, which is for people.
const NAME_LENGTH: usize = 200;
const STATES_LIMIT: usize = 32;
const SAMPLES_LIMIT: usize = 4096;

/// A connected machine; clones are handles of the same connection.
#[derive(Clone)]
pub struct Machine {
    inner: Arc<Connection>,
}

impl ConnectOptions {
    /// Finds the machine and connects to it.
    ///
    /// # Errors
    /// MC530 none comes within the time, MC531 more than one is there and none is named, MC533 another version of the
    /// protocol, MC537 the configuration.
    pub async fn connect(self) -> Result<Machine> {
        Machine::open(self).await
    }
}

impl Machine {
    /// Connects to the machine that the environment names (`MC_MACHINE`, `MC_CONNECT`), else to this computer's only
    /// one. [`ConnectOptions`] has the rest.
    ///
    /// # Errors
    /// As [`ConnectOptions::connect`].
    pub async fn connect() -> Result<Self> {
        ConnectOptions::new().connect().await
    }

    pub(crate) async fn open(options: ConnectOptions) -> Result<Self> {
        let client = options.client_id()?;
        let link = options.link().await?;
        match Self::on(link.clone(), options, client).await {
            Ok(machine) => Ok(machine),
            Err(error) => {
                link.close().await;
                Err(error)
            }
        }
    }

    async fn on(link: Link, options: ConnectOptions, client: String) -> Result<Self> {
        let machine = find_machine(&link, options.machine.as_deref(), options.timeout).await?;
        let presence = Arc::new(Presence::new(&machine));
        let keys = Arc::new(Keys { machine, client });
        let link = link.believing(&presence);
        let watching = Arc::clone(&presence);
        let watch = link.watch_tokens(&keys.live(), move |key, gone| watching.on_token(key, gone)).await?;
        presence.wait_online(options.timeout).await;
        let caller = Caller::new(link.clone(), Arc::clone(&keys), Arc::clone(&presence));
        let trying = Trying::within(options.timeout.max(DEADLINE));
        let info: Info = decode(&caller.call("info", &Nothing {}, trying).await?)?;
        if !info.protocol.is_empty() && !info.protocol.contains(&PROTOCOL_VERSION) {
            return Err(Error::Protocol(Box::new(Problem::new(
                "MC533",
                format!(
                    "{} speaks protocol {:?}, this client {PROTOCOL_VERSION}",
                    keys.machine, info.protocol
                ),
                "use the version of this crate that belongs to the server",
            ))));
        }
        let patience = options.patience;
        Ok(Self {
            inner: Arc::new(Connection {
                link,
                keys,
                caller,
                patience,
                presence,
                options,
                info: Arc::new(RwLock::new(Arc::new(info))),
                token: OnceCell::new(),
                watch: Mutex::new(Some(watch)),
            }),
        })
    }

    /// Ends the link; programs still open end now as their `on_disconnect` says, without their grace.
    pub async fn close(&self) {
        if self.inner.token.initialized() {
            // a server that does not hear it sees the token go
            let trying = Trying {
                deadline: LEAVE,
                ..Trying::default()
            };
            let _ = self.inner.caller.call("leave", &Nothing {}, trying).await;
        }
        lock(&self.inner.watch).take();
        self.inner.link.close().await;
    }

    // ------------------------------------------------------------ what it is and does

    /// The machine's name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.inner.keys.machine
    }

    /// This client's id.
    #[must_use]
    pub fn client(&self) -> &str {
        &self.inner.keys.client
    }

    /// Axes, limits, tools, units; as of the connection or the last [`Machine::refresh_info`].
    #[must_use]
    pub fn info(&self) -> Arc<Info> {
        self.inner.info()
    }

    /// Whether the server is there now.
    #[must_use]
    pub fn online(&self) -> bool {
        self.inner.presence.online()
    }

    /// Asks again, such as after the server was started anew.
    ///
    /// # Errors
    /// [`Error::NobodyAnswers`], [`Error::NoAnswerInTime`], [`Error::RequestRefused`]; so all calls below.
    pub async fn refresh_info(&self) -> Result<Arc<Info>> {
        let info: Arc<Info> = Arc::new(self.ask_info().await?);
        *self.inner.info.write().unwrap_or_else(PoisonError::into_inner) = Arc::clone(&info);
        Ok(info)
    }

    /// Calls any remote method by its name (docs/wire/calls.md); the request is numbered and repeated until it is
    /// answered.
    ///
    /// # Errors
    /// As [`Machine::refresh_info`].
    pub async fn call<T: DeserializeOwned>(&self, method: &str, fields: &impl Serialize) -> Result<T> {
        self.inner.ask(method, fields, DEADLINE).await
    }

    /// A method of the table, within its deadline [s].
    pub(crate) async fn ask_within<T: DeserializeOwned>(
        &self,
        method: &str,
        fields: &impl Serialize,
        seconds: u64,
    ) -> Result<T> {
        self.inner.ask(method, fields, Duration::from_secs(seconds)).await
    }

    pub(crate) async fn declare_token(&self) -> Result<()> {
        self.inner.declare_token().await
    }

    // ------------------------------------------------------------ programs

    /// Opens a program; the default request leases all axes, and stops it when this client's link goes.
    ///
    /// # Errors
    /// As [`Machine::refresh_info`].
    pub async fn program(&self, request: OpenRequest) -> Result<Program> {
        let name = request.name.chars().take(NAME_LENGTH).collect();
        let opened = self.open_program(&OpenRequest { name, ..request }).await?;
        self.follow(Core::new(&opened, Bounds::default()), opened.axes).await
    }

    /// Goes on with a program that has ended, such as by a restart of the server: energizes what it had, brings the
    /// axes to where its next line starts, and runs the lines that the journal has.
    ///
    /// `show` gets before that what ran, where the axes stand and where the program has them; where it fails, nothing
    /// moves. Where the text was not whole, lines behind [`Program::given_through`] have to be sent.
    ///
    /// # Errors
    /// As [`Machine::refresh_info`]; MC450, MC592, MC593, MC594 what has to be done or said first; nothing has moved.
    pub async fn continue_program(
        &self,
        request: &ContinueRequest,
        show: impl FnOnce(&Continuation) -> Result<()>,
    ) -> Result<Program> {
        let asked = ContinuationRequest {
            program: Some(request.program.clone()),
            line: request.line,
            ..ContinuationRequest::default()
        };
        show(&self.continuation(&asked).await?)?;
        let opened = self.open_continuation(request).await?;
        self.follow(Core::continuing(&opened, Bounds::default()), opened.axes).await
    }

    pub(crate) async fn follow(&self, core: Core, axes: Vec<u64>) -> Result<Program> {
        let inner = &self.inner;
        let stream = LineStream::open(
            core,
            inner.link.clone(),
            Arc::clone(&inner.keys),
            inner.caller.clone(),
            &inner.presence,
            inner.patience,
        )
        .await?;
        Ok(Program::new(stream, Arc::clone(inner), axes))
    }

    // ------------------------------------------------------------ the operator's part

    /// Moves one axis on until the result is stopped or dropped; `velocity` is signed [mm/s, deg/s].
    ///
    /// `hold` is the dead man's time (0.5 s where none is given): when this program or its link dies, the axis stops
    /// after it.
    ///
    /// # Errors
    /// As [`Machine::refresh_info`]; MC512 the axis is leased.
    pub async fn jog_held(&self, axis: u64, velocity: f64, hold: Option<Duration>) -> Result<HeldJog> {
        self.inner.declare_token().await?;
        jog_held(&self.inner.caller, axis, velocity, hold).await
    }

    /// Emergency stop: at once on this machine's link, and on a session of its own as soon as that is open; returns
    /// once the server has confirmed. No safety function: see [`EmergencyStop`].
    ///
    /// # Errors
    /// MC532 no confirmation within the time: use the machine's own circuit.
    pub async fn estop(&self, reason: &str, limit: Duration) -> Result<()> {
        let here = send_until_confirmed(&self.inner.link, &self.inner.keys, reason, limit);
        let options = self.inner.options.clone().machine(self.name());
        let beside = async {
            let button = EmergencyStop::connect(&options).await?;
            let stopped = button.press(reason, limit).await;
            button.close().await;
            stopped
        };
        tokio::pin!(here, beside);
        tokio::select! {
            stopped = &mut here => match stopped {
                Ok(()) => Ok(()),
                Err(_) => beside.await,
            },
            stopped = &mut beside => match stopped {
                Ok(()) => Ok(()),
                Err(_) => here.await,
            },
        }
    }

    // ------------------------------------------------------------ what it says

    /// Listens to the whole machine's state, some 20 times a second; a slow reader gets the newest ones.
    ///
    /// # Errors
    /// MC539 the client is closed.
    pub async fn telemetry(&self) -> Result<Feed<MachineStatus>> {
        self.inner.feed(&self.inner.keys.state(), STATES_LIMIT, decode).await
    }

    /// Listens to every cycle of every axis, some cycles at a time.
    ///
    /// # Errors
    /// MC539 the client is closed.
    pub async fn samples(&self) -> Result<Feed<Samples>> {
        let info = Arc::clone(&self.inner.info);
        let read = move |payload: &[u8]| {
            let now = Arc::clone(&info.read().unwrap_or_else(PoisonError::into_inner));
            decode_samples(payload, &now)
        };
        self.inner.feed(&self.inner.keys.samples(), SAMPLES_LIMIT, read).await
    }

    /// Listens to events in order and without gap from now on; with `history` those that the server still has come
    /// first.
    ///
    /// # Errors
    /// As [`Machine::refresh_info`].
    pub async fn events(&self, history: bool) -> Result<Feed<Event>> {
        self.inner.open_events(history, None).await
    }
}
