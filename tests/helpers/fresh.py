"""Processes that know nothing but some imports: forks of one that is started with these, and does nothing else."""

import json
import subprocess
import sys
from contextlib import contextmanager

SERVER = """
import json, os, sys

exec(sys.argv[1])
for line in sys.stdin:
    code, arguments, folder, said = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        sys.argv[1:] = arguments
        sys.path.insert(0, folder)
        for number in (1, 2):
            os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
        exec(code, {"__name__": "__main__"})
        sys.exit()
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@contextmanager
def after(imports):
    """Gives a function that runs `code` with `arguments` within `folder`, first on the path of modules, in a process
    that has only made `imports`; it returns what the code printed. AssertionError, with all of that, where it fails.
    """
    command = [sys.executable, "-c", SERVER, imports]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:

        def run(folder, code, *arguments):
            said = folder / "said.txt"
            print(json.dumps([code, list(map(str, arguments)), str(folder), str(said)]), file=server.stdin, flush=True)
            status = server.stdout.readline()
            printed = said.read_text() if said.exists() else ""
            assert status == "0\n", printed
            return printed

        yield run
        server.stdin.close()
