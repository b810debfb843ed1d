"""Allowed requests by state and by sender: sections 8 and 20 of SPEC.md as tables."""

#: The columns of section 8's table, without JUDGE and CORRECT, since the server judges the cells of these sessions,
#: and without TANGENT and COTANGENT, which change nothing: they are played after other requests (:mod:`.played`).
OPERATIONS = (
    "JOIN", "UPLOAD", "BUILD", "MOVE", "COMMIT", "ROLLBACK", "FETCH", "STATUS", "CLOSE", "RESUME", "LEASE_END",
)  # fmt: skip
#: Its rows: what is not refused.
ADMITTED = {
    "NEW": "JOIN UPLOAD STATUS CLOSE RESUME LEASE_END",
    "OPENING": "JOIN UPLOAD BUILD STATUS CLOSE RESUME LEASE_END",
    "READY": "JOIN MOVE ROLLBACK FETCH STATUS CLOSE RESUME LEASE_END",
    "TRIAL": "JOIN MOVE COMMIT ROLLBACK FETCH STATUS CLOSE RESUME LEASE_END",
    "COMMITTING": "STATUS LEASE_END",
    "SUSPENDED": "JOIN STATUS CLOSE RESUME LEASE_END",
    "FROZEN": "JOIN FETCH STATUS CLOSE LEASE_END",
    "FAILED": "JOIN STATUS CLOSE LEASE_END",
    "CLOSED": "LEASE_END",
}
#: Requests that every partition has to make.
COLLECTIVE = ("BUILD", "MOVE", "COMMIT", "ROLLBACK")
#: Section 20: the requests that others than a session's owner may send, and the answer to all other requests.
OTHERS = {
    "stranger": ("", "NOT_FOUND"),
    "unlisted": ("", "UNAUTHENTICATED"),
    "monitor": ("STATUS PROBE", "PERMISSION_DENIED"),
    "admin": ("STATUS CLOSE PROBE", "PERMISSION_DENIED"),
}
DISK = "RESOURCE_EXHAUSTED.DISK"
