#!/usr/bin/env bash
# What is looked at; tests/container/run starts it in namespaces of its own. Each check is a sentence.
set -uo pipefail
job=$1
shift
token=$job/etc/operator.token gateway=docker_gateway-virtual_1
export DOCKER_HOST=unix://$job/engine.sock

# What the engine says of systemd, which is not here and would call the health check, is left out.
engine() { podman "$@" 2> >(grep -v systemd >&2); }
compose() { docker-compose --file docker/compose.yaml --profile "$1" "${@:2}" >"$job/composed" 2>&1 || { cat "$job/composed"; return 1; }; }
one() { engine run --rm --network none --read-only --cap-drop all --security-opt no-new-privileges --health-interval disable "$@"; }
fails() { echo "    $*"; return 1; }
# WHAT EXPECTED FOUND
is() { [ "$2" = "$3" ] || fails "$1: expected \`$2\`, found \`$3\`"; }
# WORDS TEXT
says() { case $2 in *"$1"*) ;; *) fails "\`$1\` is not in: $2" ;; esac; }
of_gateway() { engine inspect --format "{{$1}}" "$gateway"; }
# Exit code and words of the health check, as an engine calls it.
health() { said=$(engine healthcheck run "$gateway" 2>&1 >/dev/null; echo "code $?"); said+=$(engine exec "$gateway" isotherm status --healthy 2>&1); }
# SECONDS WORDS: the health check says so within that time.
health_says() {
    local until=$((SECONDS + $1))
    while health; [[ $said != *"$2"* ]]; do
        [ "$SECONDS" -lt "$until" ] || { fails "no \`$2\` within $1 s: $said"; return 1; }
        sleep 1
    done
}
profile() {
    cp "profiles/$1.toml" "$job/etc/machine.toml"
    rm -f "$token"
    one isotherm token | install -m 600 -o 10001 -g 10001 /dev/stdin "$token"
}

the_image_has_one_program_and_no_shell() {
    local tree programs
    tree=$(engine image mount isotherm)
    programs=$(cd "$tree" && find . -type f -perm /111 ! -path './lib*/*.so*' | sort)
    is programs ./usr/bin/isotherm "$programs" && is 'owner of the state' '10001:10001 750' "$(stat -c '%u:%g %a' "$tree/var/lib/isotherm")" &&
        says "GNU C Library" "$(cat "$tree/usr/share/doc/libc6/copyright")" && [ -s "$tree/usr/share/doc/isotherm/third-party-notices.gz" ]
}

the_image_says_who_runs_it_and_how_it_is_asked_for_its_health() {
    local config
    config=$(engine image inspect isotherm --format '{{.User}} {{.Config.Entrypoint}} {{.Config.Volumes}} {{.HealthCheck.Test}}')
    is config '10001:10001 [/usr/bin/isotherm] map[] [CMD /usr/bin/isotherm status --healthy]' "$config" &&
        is licence Apache-2.0 "$(engine image inspect isotherm --format '{{index .Labels "org.opencontainers.image.licenses"}}')" &&
        echo "    the image has $(engine image inspect isotherm --format '{{.Size}}') bytes"
}

it_runs_without_a_network_a_capability_or_a_place_to_write() {
    profile parts-vmc
    says 'isotherm ' "$(one isotherm --version)" &&
        says 'at most' "$(one --volume /etc/isotherm:/etc/isotherm:ro isotherm check /etc/isotherm/machine.toml 2>&1)"
}

# OPTIONS OF THE ENGINE: what the gateway says at its start.
start_with() {
    local said=
    engine run --detach --name tried --network none --health-interval disable --volume /etc/isotherm:/etc/isotherm:ro "$@" \
        isotherm run /etc/isotherm/machine.toml --set bus.control.address=127.0.0.1:2 >/dev/null
    until [[ $said == *'the gateway runs'* ]] || [ "$(engine inspect --format '{{.State.Status}}' tried)" = exited ]; do
        sleep 0.2
        said=$(engine logs tried 2>&1)
    done
    engine rm --force --time 5 --volumes tried >/dev/null
    echo "$said"
}

state_that_goes_with_the_container_is_warned_of_and_other_is_not() {
    profile parts-vmc
    local said
    says "the writable layer of this container" "$(start_with)" && says 'an anonymous volume' "$(start_with --volume /var/lib/isotherm)" || return 1
    said=$(start_with --volume kept:/var/lib/isotherm)
    says 'the gateway runs' "$said" && case $said in *'the saved state in'*) fails "$said" ;; esac
}

a_wrong_profile_is_tried_five_times_and_no_more() {
    profile parts-vmc
    sed -i 's/^limit .*/limit = "many"/' "$job/etc/machine.toml"
    compose tcp up --detach
    local until=$((SECONDS + 60)) now before=
    while now=$(engine inspect --format '{{.RestartCount}} {{.State.ExitCode}} {{.State.Status}}' docker_gateway-tcp_1) && [ "$now" != '5 64 exited' ]; do
        [ "$SECONDS" -lt "$until" ] || { fails "after 60 s: $now"; break; }
        sleep 1
    done
    sleep 5
    before=$(engine inspect --format '{{.RestartCount}} {{.State.ExitCode}} {{.State.Status}}' docker_gateway-tcp_1)
    compose tcp down --volumes
    is restarts '5 64 exited' "$before"
}

# The commands of the manual, where `docker` is this engine, and whoever runs this is root.
sudo() { "$@"; }
docker() {
    local words=() word
    case $1 in
    run) engine run --health-interval disable "${@:2}" ;;
    compose)
        # It has no terminal here.
        for word in "${@:2}"; do words+=("$word"); [ "$word" != exec ] || words+=(-T); done
        docker-compose "${words[@]}"
        ;;
    esac
}
# SECONDS COMMAND: it works within that time; what it said is in $job/said.
works() {
    local until=$((SECONDS + $1))
    until (cd "$job/shop" && eval "$2") >"$job/said" 2>&1 </dev/null; do
        [ "$SECONDS" -lt "$until" ] || { fails "$2: $(cat "$job/said")"; return 1; }
        sleep 1
    done
}

what_the_manual_says_makes_a_gateway_of_a_profile() {
    rm -f "$job/etc"/*
    mkdir -p "$job/shop" && ln -sfn "$PWD/docker" "$job/shop/docker" && cp profiles/parts-vmc.toml "$job/shop/my-machine.toml"
    local command commands found=0
    mapfile -t commands < <(tests/verbs/manual/commands docs/installing.md tests/container/run | grep -v docker/build)
    for command in "${commands[@]}"; do
        case $command in *' exec '*) works 60 "$command" ;; *) works 0 "$command" ;; esac || { found=1; break; }
    done
    [ "$found" = 1 ] || { says parts-vmc "$(cat "$job/said")" && is 'owner of the token' '10001:10001 600' "$(stat -c '%u:%g %a' "$token")" &&
        is 'the page asks for it' 401 "$(curl --silent --output /dev/null --write-out '%{http_code}' http://127.0.0.1:8080/api/status)"; } || found=1
    compose tcp down --volumes && return "$found"
}

with_serial_ports_it_is_in_their_group_and_sees_them() {
    profile parts-vmc
    local pid found
    compose serial up --detach || return 1
    pid=$(engine inspect --format '{{.State.Pid}}' docker_gateway-serial_1)
    says ' 20 ' " $(sed -n 's/^Groups:\t//p' "/proc/$pid/status") " && [ -e "/proc/$pid/root/dev/null" ] &&
        is 'character devices' "$(find /dev -maxdepth 1 -name 'tty[SUA]*' | wc -l)" "$(find "/proc/$pid/root/dev/" -maxdepth 1 -name 'tty[SUA]*' | wc -l)"
    found=$?
    compose serial down --volumes && return "$found"
}

it_compensates_in_a_network_of_its_own_without_rights() {
    profile parts-vmc
    local begun=$SECONDS pid
    compose virtual up --detach && health_says 120 'code 0' || return 1
    echo "    healthy after $((SECONDS - begun)) s, 30 s of which its references settle"
    pid=$(of_gateway .State.Pid)
    is user $'10001\t10001\t10001\t10001' "$(sed -n 's/^Uid:\t//p' "/proc/$pid/status")" &&
        is capabilities 0000000000000000 "$(sed -n 's/^CapBnd:\t//p' "/proc/$pid/status")" &&
        is 'no new privileges' 1 "$(sed -n 's/^NoNewPrivs:\t//p' "/proc/$pid/status")" &&
        is root ro "$(awk '$5 == "/" { print substr($6, 1, 2) }' "/proc/$pid/mountinfo")" &&
        is profile ro "$(awk '$5 == "/etc/isotherm" { print substr($6, 1, 2) }' "/proc/$pid/mountinfo")" &&
        { [ "$(readlink "/proc/$pid/ns/net")" != "$(readlink /proc/self/ns/net)" ] || fails 'it has the network of this side'; } &&
        is 'log of at most' 10MB "$(of_gateway .HostConfig.LogConfig.Size)"
}

its_page_answers_this_side_of_the_network_and_asks_for_the_token() {
    local page=http://127.0.0.1:8080/api/status
    is 'without a token' 401 "$(curl --silent --output /dev/null --write-out '%{http_code}' "$page")" &&
        is 'with a wrong one' 401 "$(curl --silent --output /dev/null --write-out '%{http_code}' --header 'Authorization: Bearer 0123456789abcdef' "$page")" &&
        says '"machine":"parts-vmc"' "$(curl --silent --header "Authorization: Bearer $(cat "$token")" "$page")"
}

a_lost_device_is_sick_and_one_that_is_back_is_not() {
    compose virtual stop machine && health_says 30 'code 1' && says 'device control: lost' "$said" || return 1
    compose virtual start machine && health_says 120 'code 0'
}

an_axis_that_a_person_switched_off_is_not_sick() {
    engine exec "$gateway" isotherm disarm /etc/isotherm/machine.toml >/dev/null && health_says 5 'code 0' &&
        says 'axis y is off: switched off by a person' "$said" && engine exec "$gateway" isotherm arm /etc/isotherm/machine.toml >/dev/null
}

it_stops_at_zero_and_another_container_goes_on_with_its_state() {
    local begun=$SECONDS said
    compose virtual stop && is 'exit code' 0 "$(of_gateway .State.ExitCode)" && says 'cnc_y holds 0.0 µm' "$(engine logs "$gateway" 2>&1)" || return 1
    echo "    stopped within $((SECONDS - begun)) s"
    case $(engine logs "$gateway" 2>&1) in *'the saved state in'*) fails 'it warned of a named volume'; return 1 ;; esac
    compose virtual down && compose virtual up --detach && health_says 120 'code 0' || return 1
    said=$(engine exec "$gateway" isotherm events /etc/isotherm/machine.toml --json)
    is 'starts that it knows of' 2 "$(grep -c '"kind":"started"' <<<"$said")"
}

setsid podman system service --time 0 "$DOCKER_HOST" >"$job/engine" 2>&1 &
until [ -S "$job/engine.sock" ]; do sleep 0.1; done
failed=0
for check in the_image_has_one_program_and_no_shell the_image_says_who_runs_it_and_how_it_is_asked_for_its_health \
    it_runs_without_a_network_a_capability_or_a_place_to_write state_that_goes_with_the_container_is_warned_of_and_other_is_not \
    a_wrong_profile_is_tried_five_times_and_no_more what_the_manual_says_makes_a_gateway_of_a_profile with_serial_ports_it_is_in_their_group_and_sees_them \
    it_compensates_in_a_network_of_its_own_without_rights \
    its_page_answers_this_side_of_the_network_and_asks_for_the_token a_lost_device_is_sick_and_one_that_is_back_is_not \
    an_axis_that_a_person_switched_off_is_not_sick it_stops_at_zero_and_another_container_goes_on_with_its_state; do
    [[ "${check//_/ }" == *"${*:-}"* ]] || continue
    begun=$SECONDS
    if "$check"; then verdict=ok; else verdict=FAILED failed=1; fi
    printf '%-6s %3d s  %s\n' "$verdict" $((SECONDS - begun)) "${check//_/ }"
done
compose virtual down --volumes
exit "$failed"
