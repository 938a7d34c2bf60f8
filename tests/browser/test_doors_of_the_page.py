"""The page with logins: who only looks, deep links, headers, and who may scrape its metrics."""

from __future__ import annotations

import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator

import pytest

from mcserver.web.users import Role, add_user
from tests.browser.conftest import PageProcess, expect, page_of, playwright
from tests.e2e.servers import ServerProcess


@pytest.fixture(scope="module")
def site(server: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    folder = tmp_path_factory.mktemp("doors")
    users = folder / "users"
    add_user(users, "olga", Role.OBSERVER, "olgas-password")
    with page_of(server.endpoint, folder, "--users", str(users)) as made:
        yield made


def test_a_login_leads_to_the_page_that_was_asked_for_and_an_observer_cannot_press_what_is_refused(
    page: playwright.Page, site: PageProcess
) -> None:
    page.goto(f"{site.url}machine/bench")
    page.get_by_label("Name").fill("olga")
    page.get_by_label("Password").fill("olgas-password")
    page.get_by_role("button", name="Log in").click()
    expect(page).to_have_url(f"{site.url}machine/bench")
    expect(page.get_by_role("status")).to_have_text("ready")
    for name in ("Run", "Energize", "Abort", "jog axis X plus"):
        expect(page.get_by_role("button", name=name, exact=True).first).to_be_disabled()
    expect(page.get_by_role("button", name="Emergency stop")).to_be_enabled()


def answered(request: urllib.request.Request) -> tuple[int, dict[str, str]]:
    try:
        with urllib.request.urlopen(request) as reply:
            return reply.status, dict(reply.headers)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, dict(error.headers)


def test_no_other_site_frames_the_page_and_metrics_are_for_this_computer_itself(site: PageProcess) -> None:
    url = f"{site.url}metrics"
    status, headers = answered(urllib.request.Request(url))
    assert status == 200
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["x-frame-options"] == "DENY"
    for foreign in ({"Host": "evil.example"}, {"X-Forwarded-For": "203.0.113.7"}):
        assert answered(urllib.request.Request(url, headers=foreign))[0] == 403


@pytest.mark.parametrize(
    ("then", "led"),
    [
        ("//evil.example", "/"),
        ("/\\evil.example", "/"),
        ("/x\r\nSet-Cookie: a=b", "/"),
        ("/?search=a*,(b)&group=hall-2", "/?search=a*,(b)&group=hall-2"),
    ],
)
def test_a_cookie_is_secure_behind_a_proxy_that_ends_tls_and_the_way_stays_on_this_site(
    site: PageProcess, then: str, led: str
) -> None:
    form = urllib.parse.urlencode({"name": "olga", "password": "olgas-password", "then": then}).encode()
    headers = {"X-Forwarded-Proto": "https, http"}
    request = urllib.request.Request(f"{site.url}login", data=form, headers=headers)

    class Stay(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, *_: object) -> None:
            return None

    with pytest.raises(urllib.error.HTTPError) as answer:
        urllib.request.build_opener(Stay).open(request)
    answer.value.close()
    assert answer.value.headers["location"] == led
    assert "Secure" in answer.value.headers["set-cookie"]
