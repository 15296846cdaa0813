# Sourced by the commands in scripts/: makes the checkout's environment, or finds it made.
#
# Sets CHECKOUT (the top folder) and VENV (its environment). The environment is kept for as long
# as pyproject.toml, constraints.txt and this file stay the same. Prints only when it works.

CHECKOUT=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd -P)
VENV="$CHECKOUT/.venv"
SYSTEM_LIBRARIES=(libegl1 libgl1 libx11-6 libusb-1.0-0 libgomp1)  # what open3d loads

fail() {
    printf 'error: %s\n' "$1" >&2
    exit 1
}

find_python() {
    local name
    for name in python3.11 python3 python3.12 python3.13; do
        if command -v "$name" >/dev/null &&
            "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$name"
            return
        fi
    done
    fail 'no Python 3.11 or newer was found; on Debian 12: apt-get install python3 python3-venv'
}

# Installs Debian packages where that is possible, else says in one line what to install.
need_packages() {
    local why=$1
    shift
    if [[ $(id -u) != 0 ]] || ! command -v apt-get >/dev/null; then
        fail "$why; as root: apt-get install $*"
    fi
    printf 'Installing system packages: %s\n' "$*"
    {
        apt-get update -qq &&
            DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@"
    } >/dev/null || fail "$why, and apt-get could not install it; as root: apt-get install $*"
}

fingerprint() {
    {
        printf '%s\n' "$CHECKOUT"  # an environment does not survive that its checkout is moved
        cat "$CHECKOUT/pyproject.toml" "$CHECKOUT/constraints.txt" "${BASH_SOURCE[0]}"
    } | sha256sum | cut -d ' ' -f 1
}

make_environment() {
    local python fingerprint=$1
    # The folder it leads to is that of another checkout, and would be emptied.
    [[ ! -L "$VENV" ]] || fail "$VENV is a link; remove it: each checkout has its own environment"
    python=$(find_python) || exit 1
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        # A machine as bare as that lacks the libraries of open3d too: all is named at once.
        need_packages "$python cannot make environments" \
            "python$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv" \
            "${SYSTEM_LIBRARIES[@]}"
    fi
    if [[ ! -x "$VENV/bin/python" || $(cat "$VENV/begun" 2>/dev/null) != "$fingerprint" ]]; then
        printf 'Making an environment in %s\n' "$VENV"
        "$python" -m venv --clear "$VENV" || fail "no environment could be made in $VENV"
        printf '%s\n' "$fingerprint" >"$VENV/begun"
    fi
    printf 'Installing packages (about 1 GB with what they need; once)\n'
    (
        cd -- "$CHECKOUT"
        export PIP_DISABLE_PIP_VERSION_CHECK=1
        "$VENV/bin/python" -m pip install --quiet --constraint constraints.txt setuptools
        "$VENV/bin/python" -m pip install --quiet --constraint constraints.txt \
            --no-build-isolation --editable '.[dev]'
    ) || fail 'pip could not install the packages; its own message stands above'
    if ! "$VENV/bin/python" -c 'import open3d' >/dev/null 2>&1; then
        need_packages 'open3d lacks system libraries' "${SYSTEM_LIBRARIES[@]}"
        "$VENV/bin/python" -c 'import open3d' >/dev/null || fail 'open3d cannot be imported'
    fi
    printf '%s\n' "$fingerprint" >"$VENV/done"
}

# The server for tests of the service's store. Where it cannot be installed they are skipped.
ensure_postgresql() {
    if command -v initdb >/dev/null || compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null; then
        return
    fi
    if [[ $(id -u) == 0 ]] && command -v apt-get >/dev/null; then
        # In a subshell: without it the other tests still run.
        (need_packages 'the store of the service is tested on PostgreSQL' postgresql) ||
            printf 'The tests on PostgreSQL are skipped\n'
    else
        printf 'No PostgreSQL is installed: its tests are skipped (apt-get install postgresql)\n'
    fi
}

# The browser for tests of the page. Where it cannot be installed they are skipped.
ensure_chromium() {
    if command -v chromium >/dev/null || command -v google-chrome >/dev/null; then
        return
    fi
    if [[ $(id -u) == 0 ]] && command -v apt-get >/dev/null; then
        (need_packages 'the page of the service is tested in Chromium' chromium) ||
            printf 'The tests of the page are skipped\n'
    else
        printf 'No Chromium is installed: tests of the page are skipped (apt-get install chromium)\n'
    fi
}

ensure_environment() {
    local fingerprint
    fingerprint=$(fingerprint)
    # Two commands started together: the second waits and finds the environment made.
    exec 9<"$CHECKOUT"
    flock 9
    if [[ $(cat "$VENV/done" 2>/dev/null) != "$fingerprint" ]]; then
        make_environment "$fingerprint"
    fi
    exec 9<&-
}
