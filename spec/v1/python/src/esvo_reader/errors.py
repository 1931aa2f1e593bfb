"""Findings, and the one error of this package."""

from __future__ import annotations

from typing import NamedTuple, Sequence

#: Rules of level should (appendix C): readers accept files that break them.
SHOULD = frozenset({"M002", "M003", "M004", "B012", "S009", "A006"})


class Finding(NamedTuple):
    """Something that is wrong with a file."""

    #: Id of the rule in appendix C, or "LIMIT" where the file asks for more than this reader was allowed to take.
    rule: str
    #: "error" for a rule marked must, "warning" for one marked should.
    severity: str
    #: Where in the file, in bytes. For data inside a compressed block: where the block starts.
    offset: int
    #: What was found, in English.
    message: str

    def __str__(self) -> str:
        return f"{self.severity} {self.rule} at byte {self.offset}: {self.message}"


class EsvoError(Exception):
    """The file, or the part of it that was read, breaks a rule of the specification."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        super().__init__(str(findings[0]))
        #: All errors that were found at once; the first is the one in the message.
        self.findings = list(findings)

    @property
    def rule(self) -> str:
        """Id of the rule that is broken."""
        return self.findings[0].rule


class Findings:
    """Collects findings while a part of a file is checked."""

    def __init__(self) -> None:
        self.items: list[Finding] = []

    @property
    def errors(self) -> list[Finding]:
        return [f for f in self.items if f.severity == "error"]

    def add(self, rule: str, offset: int, message: str) -> None:
        self.items.append(Finding(rule, "warning" if rule in SHOULD else "error", int(offset), message))

    def require(self, condition: object, rule: str, offset: int, message: str) -> None:
        """Adds a finding unless the condition holds."""
        if not condition:
            self.add(rule, offset, message)

    def settle(self) -> None:
        """Raises if there are errors. Called where the next step relies on what was checked."""
        if self.errors:
            raise EsvoError(self.errors)
