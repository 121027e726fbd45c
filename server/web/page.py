"""A page: its template, how it looks at the store, and its parts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy.engine import Engine

from server.web.assets import templates

#: How blocks of a template begin that are parts of the page.
LIVE = "live_"
#: A figure among the parts of a page is called so and by its name.
FIGURE = "figure:"


@dataclass(frozen=True, kw_only=True)
class Look:
    """What a page is asked to show, and where it finds it."""

    engine: Engine
    now: float
    #: Whether whoever looks may change something.
    may_submit: bool
    #: What the address says: names in its path, and the choices behind the "?".
    names: Mapping[str, str] = field(default_factory=dict)
    choices: Mapping[str, str] = field(default_factory=dict)
    #: What is kept in memory (`app.state`).
    state: Any = None


@dataclass(frozen=True, kw_only=True)
class Page:
    """One page.

    `look` returns what the template shows; under "figures", figures by name, which browsers draw.
    """

    path: str
    template: str
    look: Callable[[Look], Mapping[str, Any]]
    #: What `look` reads of the address behind the "?"; the rest changes nothing that is shown.
    choices: tuple[str, ...] = ()

    def key(self, look: Look) -> tuple[object, ...]:
        """Return what those have in common who are shown the same."""
        chosen = [(name, look.choices.get(name)) for name in self.choices]
        return (self.path, *sorted(look.names.items()), "?", *chosen, look.may_submit)

    def parts(self, look: Look) -> dict[str, Any]:
        """Return what may change of a page: the HTML of each part, and its figures."""
        content = dict(self.look(look))
        figures = content.pop("figures", {})
        template = templates().get_template(self.template)
        context = template.new_context({**content, "may_submit": look.may_submit})
        html = {
            name.removeprefix(LIVE): "".join(block(context))
            for name, block in template.blocks.items()
            if name.startswith(LIVE)
        }
        return html | {FIGURE + name: figure for name, figure in figures.items()}

    def html(self, look: Look, *, stream: str) -> str:
        """Return the whole page; `stream` is where its changes come from."""
        content = dict(self.look(look))
        content.pop("figures", None)
        template = templates().get_template(self.template)
        return template.render(**content, may_submit=look.may_submit, stream=stream)
