"""Questions about masks: names joined by relations in space and time, as a small grammar without a model of language.

    question   = [when [not]] clause time*                       grasper touching liver · when is no grasper
    time       = (when | while) [not] clause | before clause | after clause | first | last | largest | smallest
    clause     = list [not list]                                 tool but not (hook or scissors)
    list       = both (or both)*                                 `and` binds more tightly than `or`
    both       = thing (and thing)*
    thing      = [largest | smallest] name ([not] relation name ((and | or) name)*)*
    name       = words of the vocabulary | "as typed" | ( clause )
    relation   = left of | right of | above | below | touching | near | inside | between

Relations in a row are about the first name: "vessel left of the gallbladder and near the hook". `first` and `last` may stand anywhere in
a clause and choose among the frames that all other times leave. Words that join are data, `joining.json`, and those that negate are in
`names.json`. A text without them, and one that only excludes names from a name ("tool, not grasper"), is a plain prompt, which is left as
it is.
"""

from __future__ import annotations

from functools import lru_cache

from degense.engine.errors import PromptError
from degense.engine.vocabulary.concepts import MAX_PROMPT
from degense.engine.vocabulary.questions.expressions import (
    AllOf,
    AnyOf,
    ButNot,
    Expression,
    Extreme,
    Moments,
    Noun,
    Question,
    Related,
    is_relation,
    only_nouns,
)
from degense.engine.vocabulary.questions.joining_words import Token, tokens_of


@lru_cache(maxsize=1000)
def read_question(text: str, names: tuple[str, ...] = ()) -> Question:
    """What a text asks; `names` are of classes, and never taken apart.

    PromptError where a name is missing or the words cannot be brought into an order.
    """
    tokens = tokens_of(text, names) if len(text) <= MAX_PROMPT else []
    if all(token.kind == "name" for token in tokens) or tokens[0].kind == "not":
        return Question(Noun(text))  # one that says only what it does not mean is refused where names are read
    return _Parser(text, tokens).question()


class _Parser:
    """Recursive descent; each method reads what the grammar calls by its name."""

    def __init__(self, text: str, tokens: list[Token]) -> None:
        self.text, self.tokens, self.at = text, tokens, 0
        self.picked: list[Moments] = []  # first and last of the clause that is read

    def question(self) -> Question:
        absent = self._take("when") and self._take("not")
        what, picked = self._clause(), self._picked()
        times: tuple[Moments, ...] = ()
        while self._kind() is not None:
            times = (*times, *self._time())
        times = (*times, *picked)  # the first of what happens after the hook, not the first of all if it is after the hook
        whole = isinstance(what, Noun) and not times and not absent and self.tokens[0].kind == "name"
        return Question(Noun(self.text) if whole else what, times, absent)

    def _time(self) -> tuple[Moments, ...]:
        self._take("and")
        if self._kind() == "when" and self._kind(1) in ("largest", "smallest") and self._kind(2) is None:
            self.at += 1  # "when largest"
        kind = self._kind()
        if self._take("largest", "smallest"):
            return (Moments("largest" if kind == "largest" else "smallest"),)
        if not self._take("when", "before", "after"):
            rest = self.text[self.tokens[self.at].start :].strip() if kind else self.text
            raise PromptError(f"'{self.text}' cannot be read from '{rest}' on; put parentheses around what belongs together.")
        negated = kind == "when" and self._take("not")
        of = Question(self._clause(), self._picked())
        return (Moments("when not" if negated else "when" if kind == "when" else "before" if kind == "before" else "after", of),)

    def _clause(self) -> Expression:
        start = self.at
        what = self._list()
        while self._take("not"):
            other = self._list()
            plain = isinstance(what, Noun) and only_nouns(other)
            what = Noun(self._typed(start)) if plain else ButNot(what, other)
        return what

    def _list(self) -> Expression:
        parts = [self._both()]
        while self._take("or"):
            parts.append(self._both())
        return parts[0] if len(parts) == 1 else AnyOf(tuple(parts))

    def _both(self) -> Expression:
        parts = [self._thing()]
        while self._kind() == "and" and self._kind(1) not in ("when", "before", "after"):
            self.at += 1
            parts.append(self._thing())
        return parts[0] if len(parts) == 1 else AllOf(tuple(parts))

    def _thing(self) -> Expression:
        self._pick()
        extreme = self._kind()
        extremes = self._take("largest", "smallest")
        what = thing = self._name()
        while True:
            self._pick()
            if self._relation_at(0) or (self._relation_at(1) and self._take("and")):
                what = self._related(what)
            elif self._relation_at(1) and self._take("or"):
                what = AnyOf((what, self._related(thing)))
            else:
                return Extreme(what, extreme == "largest") if extremes else what

    def _related(self, what: Expression) -> Expression:
        negated = self._take("not")
        relation = self._kind() or ""
        assert is_relation(relation)
        self.at += 1
        others, joined = [self._name()], ""
        between = relation == "between"
        while self._kind() in ("and", "or") and self._kind(1) in ("name", "(") and (between or not self._begins_anew()):
            joined = self._kind() or ""
            self.at += 1
            others.append(self._name())
        if joined == "and" and not between:
            for other in others:
                what = Related(what, relation, other, negated)
            return what
        return Related(what, relation, others[0] if len(others) == 1 else AnyOf(tuple(others)), negated)

    def _name(self) -> Expression:
        if self._take("("):
            inside = self._clause()
            if not self._take(")"):
                raise PromptError(f"'{self.text}' opens a parenthesis that is not closed again.")
            return inside
        if not self._take("name"):
            before = self.text[: self.tokens[self.at - 1].end].strip() if self.at else ""
            raise PromptError(f"A name is missing in '{self.text}'" + (f" after '{before}'." if before else " at its beginning."))
        return Noun(self._typed(self.at - 1))

    def _begins_anew(self) -> bool:
        """Whether what follows `and` or `or` has relations of its own."""
        depth, at = 0, self.at + 1
        while at < len(self.tokens) and (depth or at == self.at + 1):
            depth += {"(": 1, ")": -1}.get(self.tokens[at].kind, 0)
            at += 1
        return self._relation_at(at - self.at) or (at < len(self.tokens) and self.tokens[at].kind in ("first", "last"))

    def _relation_at(self, ahead: int) -> bool:
        return is_relation(self._kind(ahead)) or (self._kind(ahead) == "not" and is_relation(self._kind(ahead + 1)))

    def _pick(self) -> None:
        while (kind := self._kind()) in ("first", "last"):
            self.picked.append(Moments("first" if kind == "first" else "last"))
            self.at += 1

    def _picked(self) -> tuple[Moments, ...]:
        self._pick()
        picked, self.picked = tuple(self.picked), []
        return picked

    def _kind(self, ahead: int = 0) -> str | None:
        return self.tokens[self.at + ahead].kind if self.at + ahead < len(self.tokens) else None

    def _take(self, *kinds: str) -> bool:
        taken = self._kind() in kinds
        self.at += taken
        return taken

    def _typed(self, first: int) -> str:
        """What was typed from a token up to here."""
        return self.text[self.tokens[first].start : self.tokens[self.at - 1].end].strip(" ,;?!.")
