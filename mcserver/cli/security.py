"""``mcserver security init | check | router | opcua``: who may do what on a site's network."""

from __future__ import annotations

import datetime
import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from mcserver.cli.console import json_answer_on_error, narration, results, write_json, write_text
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption
from mcserver.errors import ConfigurationError, NobodyAnswers, ServiceError

if TYPE_CHECKING:
    from mcserver.security.proof import Finding
    from mcserver.security.site import Site

FolderArgument = Annotated[Path, typer.Argument(metavar="FOLDER", help="The site's folder.")]


def build_app() -> typer.Typer:
    """Return the sub-commands about access."""
    app = typer.Typer(help="Keys and access rules of a site.", no_args_is_help=True)

    @app.callback()
    def root() -> None:
        """Keys and access rules of a site."""

    app.command("init")(init)
    app.command("check")(check)
    app.command("router")(router)
    app.command("opcua")(opcua)
    return app


def init(
    folder: FolderArgument,
    router: Annotated[
        str | None,
        typer.Option("--router", metavar="HOST", help="Name or address at which all reach the router."),
    ] = None,
    port: Annotated[int | None, typer.Option("--port", metavar="N", help="The router's port: 7447.")] = None,
    machine: Annotated[
        list[str] | None, typer.Option("--machine", metavar="NAME", help="A machine. Repeatable.")
    ] = None,
    user: Annotated[
        list[str] | None,
        typer.Option(
            "--user",
            metavar="NAME:ROLE[:MACHINE,…]",
            help="A person or program; roles: observer, operator, engineer, agent. Repeatable.",
        ),
    ] = None,
    passwords: Annotated[
        bool, typer.Option("--passwords", help="Ask for user and password beside the certificate.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Make a site's authority, certificates and configurations; again with more names adds these."""
    with json_answer_on_error(json):
        import msgspec

        from mcserver.security.site import Site, parsed_user
        from mcserver.security.site_files import SITE_FILE, read_site
        from mcserver.security.site_folder import write_site

        before = read_site(folder) if (folder / SITE_FILE).exists() else None
        if before is None and router is None:
            raise ConfigurationError(
                "MC560", "a new site needs the router's host", "such as --router 192.168.1.10"
            )
        site = before or Site(router or "")
        users = {each.name: each for each in site.users}
        users |= {each.name: each for each in map(parsed_user, user or ())}
        site = msgspec.structs.replace(
            site,
            router=router or site.router,
            port=port or site.port,
            machines=tuple(dict.fromkeys((*site.machines, *(machine or ())))),
            users=tuple(users.values()),
            passwords=site.passwords or passwords,
        )
        written = write_site(folder, site, datetime.datetime.now(datetime.UTC))
    if json:
        write_json({"ok": True, "files": [str(path) for path in written]})
        return
    for path in written:
        results().print(str(path))
    for sentence in (
        f"router: zenohd --config {folder}/router.json5, or mcserver security router {folder}",
        "machine: mcserver run --zenoh-config machine.NAME.json5",
        "user: mcctl status --zenoh-config NAME.json5",
        "keep authority.key away from every other computer: who has it makes new users",
    ):
        narration().print(sentence)


def check(
    folder: FolderArgument,
    router: Annotated[
        str | None,
        typer.Option("--router", metavar="E", help="The router's endpoint, such as tls/127.0.0.1:7447."),
    ] = None,
    table: Annotated[
        bool, typer.Option("--table", help="Print what passed, by method and role, as Markdown.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Try at the running router what each machine and user may do and may not. Nothing moves."""
    with json_answer_on_error(json):
        from mcserver.net.method_pages import roles_table
        from mcserver.security.proof import passed_methods, prove
        from mcserver.security.site_files import read_site

        site = read_site(folder)
        ending = _ending(folder, site)
        for said in ending:
            narration().print(f"warning[MC563]: {said}", style="yellow")
        try:
            findings = list(prove(folder, site, router))
        except ServiceError as error:
            raise NobodyAnswers(error.code, error.message, error.hint) from error
    wrong = [each for each in findings if not each.holds]
    if json:
        tried = [
            {"who": each.who, "what": each.what, "allowed": each.allowed, "passed": each.passed}
            for each in findings
        ]
        write_json({"ok": not wrong, "attempts": tried, "ending": ending})
    elif table:
        write_text("\n".join(roles_table(passed_methods(findings, site))) + "\n")
    else:
        results().print(summary(findings))
        for each in wrong:
            found = "passed" if each.passed else "was stopped"
            narration().print(f"WRONG: {each.who}: {each.what} {found}", style="bold red")
        narration().print(f"{len(findings)} attempts, {len(wrong)} not as the rules say")
    if wrong:
        raise typer.Exit(int(ExitCode.FAILED))


def _ending(folder: Path, site: Site) -> list[str]:
    """Say which certificates of a site end soon."""
    from mcserver.security.expiry import first_ending
    from mcserver.security.site_files import ROUTER, configuration_path

    now = datetime.datetime.now(datetime.UTC)
    files = [configuration_path(folder, each) for each in (ROUTER, *site.identities())]
    return [each.said(now) for each in map(first_ending, files) if each is not None and each.is_near(now)]


def summary(findings: list[Finding]) -> Table:
    """One row for each identity: what it may and passed, what it may not and was stopped."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("who", "may", "passed", "may not", "stopped", ""):
        table.add_column(title, justify="left" if title in ("who", "") else "right")
    for who in dict.fromkeys(each.who for each in findings):
        own = [each for each in findings if each.who == who]
        may, may_not = [each for each in own if each.allowed], [each for each in own if not each.allowed]
        table.add_row(
            who,
            str(len(may)),
            str(sum(each.passed for each in may)),
            str(len(may_not)),
            str(sum(not each.passed for each in may_not)),
            "" if all(each.holds for each in own) else "WRONG",
        )
    return table


def router(
    folder: FolderArgument,
    listen: Annotated[
        str | None, typer.Option("--listen", metavar="E", help="Instead of every interface's port.")
    ] = None,
) -> None:
    """Run the site's router in this process, where there is no zenohd; until Ctrl-C or SIGTERM."""
    import json as json_text

    import zenoh

    from mcserver.security.site_files import ROUTER, configuration_path, read_site

    site = read_site(folder)
    try:
        config = zenoh.Config.from_file(configuration_path(folder, ROUTER))
        if listen is not None:
            config.insert_json5("listen/endpoints", json_text.dumps([listen]))
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise ConfigurationError(
            "MC522", "the router cannot listen", "is its port taken? see --listen"
        ) from error
    where = listen or f"tls/0.0.0.0:{site.port}"
    narration().print(f"router: {len(site.identities())} identities, listening on {where}")
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())
    stopped.wait()
    session.close()  # type: ignore[no-untyped-call]


def opcua(
    folder: FolderArgument,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of the server or client.")],
    host: Annotated[
        list[str] | None,
        typer.Option("--host", metavar="HOST", help="At which a server is reached. Repeatable."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Make certificate and key of an OPC UA server or client, signed by the site's authority."""
    with json_answer_on_error(json):
        from mcserver.security.site_folder import write_application

        now = datetime.datetime.now(datetime.UTC)
        written = write_application(folder, name, tuple(host or ()), now)
    if json:
        write_json({"ok": True, "files": [str(path) for path in written]})
        return
    for path in written:
        results().print(str(path))
