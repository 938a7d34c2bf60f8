// Foxglove's own client: subscribes to every channel and says which topics come, again after each cut.
// Arguments: the address. Lines: "info NAME", "message TOPIC NANOSECONDS", "closed CODE".
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const [address] = process.argv.slice(2);

function view() {
  const socket = new WebSocket(address, [FoxgloveClient.SUPPORTED_SUBPROTOCOL, "foxglove.sdk.v1"]);
  const client = new FoxgloveClient({ ws: socket });
  const topics = new Map();
  client.on("error", (error) => console.log(`error ${error.message}`));
  client.on("serverInfo", (info) => console.log(`info ${info.name}`));
  client.on("advertise", (channels) => {
    for (const channel of channels) topics.set(client.subscribe(channel.id), channel.topic);
  });
  client.on("message", ({ subscriptionId, timestamp }) =>
    console.log(`message ${topics.get(subscriptionId)} ${timestamp}`),
  );
  client.on("close", ({ code }) => {
    console.log(`closed ${code}`);
    setTimeout(view, 200);
  });
}

view();
