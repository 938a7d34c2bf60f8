// Starts `mcserver lsp` for G-code files and stops it with the window.
"use strict";

const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

async function start() {
  const settings = vscode.workspace.getConfiguration("mcserver");
  const folder = vscode.workspace.workspaceFolders?.[0]?.uri.fsPath;
  const server = {
    command: settings.get("command"),
    args: ["lsp", "--machine", settings.get("machine")],
    options: folder === undefined ? {} : { cwd: folder },
  };
  client = new LanguageClient("mcserver", "mcserver", server, {
    documentSelector: [{ language: "gcode" }],
  });
  await client.start();
}

// the language server draws the program and opens its page in the browser
async function draw() {
  const document = vscode.window.activeTextEditor?.document;
  if (document?.languageId !== "gcode" || client === undefined) return;
  await client.sendRequest("workspace/executeCommand", {
    command: "mcserver.draw",
    arguments: [client.code2ProtocolConverter.asUri(document.uri)],
  });
}

async function activate(context) {
  context.subscriptions.push(vscode.commands.registerCommand("mcserver.drawProgram", draw));
  // a workspace that is not trusted could name any program
  if (!vscode.workspace.isTrusted) {
    context.subscriptions.push(vscode.workspace.onDidGrantWorkspaceTrust(start));
    return;
  }
  context.subscriptions.push(
    vscode.workspace.onDidChangeConfiguration(async (change) => {
      if (change.affectsConfiguration("mcserver")) {
        await client?.stop();
        await start();
      }
    }),
  );
  await start();
}

function deactivate() {
  return client?.stop();
}

module.exports = { activate, deactivate };
