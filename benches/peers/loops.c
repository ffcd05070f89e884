/* Bare loops against the devices of the bench `peers`: read eight input registers, compute, write one register.
 *
 *   loops ping-pong PORT                    a blocking socket and nothing else: the limit
 *   loops pipelined PORT                    the same, both requests in one segment
 *   loops libmodbus PORT                    libmodbus, as its manual has it
 *   loops rtu PATH                          RTU on a serial port with system calls and nothing else: the limit
 *   loops libmodbus-rtu PATH                RTU with libmodbus, as its manual has it
 *   loops libmodbus-rtu-silent PATH         the same, with the silence after each frame that RTU requires
 *   loops sockets PORT DEVICES PERIOD_MS READS_ONLY    many devices, one thread and epoll: the limit
 *   loops threads PORT DEVICES PERIOD_MS READS_ONLY    many devices, libmodbus and a thread for each
 *
 * Device N listens on 127.0.(N / 250).(N % 250 + 1). Each runs until it is killed. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <modbus/modbus.h>
#include <netinet/tcp.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/prctl.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

enum { REGISTERS = 8, AT = 10, READ_REPLY = 25, WRITE_REPLY = 12, REQUEST = 12 };
/* Frames of RTU, and the silence between two of them above 19,200 baud. */
enum { RTU_REQUEST = 8, RTU_READ_REPLY = 21, RTU_WRITE_REPLY = 8, BAUD = 115200, SILENCE_NS = 1750000 };

static int port, period_ms, reads_only, keeps_silence;

static void give_up(const char *what)
{
    perror(what);
    exit(1);
}

static void address(int device, char *text, size_t room)
{
    snprintf(text, room, "127.0.%d.%d", device / 250, device % 250 + 1);
}

static int open_socket(int device)
{
    char text[32];
    int one = 1, it = socket(AF_INET, SOCK_STREAM, 0);
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    address(device, text, sizeof text);
    inet_pton(AF_INET, text, &at.sin_addr);
    if (it < 0 || connect(it, (struct sockaddr *)&at, sizeof at))
        give_up(text);
    setsockopt(it, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    return it;
}

/* Cz = 2.4 µm/°C · (bed − wheelhead), in counts of 0.1 µm. */
static uint16_t compute(uint16_t bed, uint16_t wheelhead)
{
    return (uint16_t)(int16_t)(2.4 * ((int16_t)bed - (int16_t)wheelhead));
}

static void ask_read(uint8_t *to, uint16_t number)
{
    const uint8_t request[REQUEST] = {(uint8_t)(number >> 8), (uint8_t)number, 0, 0, 0, 6, 1, 4, 0, 0, 0, REGISTERS};
    memcpy(to, request, REQUEST);
}

static void ask_write(uint8_t *to, uint16_t number, uint16_t value)
{
    const uint8_t request[REQUEST] = {(uint8_t)(number >> 8), (uint8_t)number, 0, 0, 0, 6, 1, 6,
                                      0, AT, (uint8_t)(value >> 8), (uint8_t)value};
    memcpy(to, request, REQUEST);
}

static void take(int it, uint8_t *reply, size_t length)
{
    for (size_t had = 0; had < length;) {
        ssize_t more = read(it, reply + had, length - had);
        if (more <= 0)
            give_up("read");
        had += (size_t)more;
    }
}

static void give(int it, const uint8_t *request, size_t length)
{
    if (write(it, request, length) != (ssize_t)length)
        give_up("write");
}

static uint16_t computed(const uint8_t *reply)
{
    return compute((uint16_t)(reply[9] << 8 | reply[10]), (uint16_t)(reply[11] << 8 | reply[12]));
}

static void ping_pong(void)
{
    uint8_t request[REQUEST], reply[READ_REPLY];
    int it = open_socket(0);
    for (uint16_t number = 0;; number += 2) {
        ask_read(request, number);
        give(it, request, REQUEST);
        take(it, reply, READ_REPLY);
        ask_write(request, number + 1, computed(reply));
        give(it, request, REQUEST);
        take(it, reply, WRITE_REPLY);
    }
}

/* The write of this cycle and the read of the next one leave together. */
static void pipelined(void)
{
    uint8_t request[2 * REQUEST], reply[WRITE_REPLY + READ_REPLY];
    int it = open_socket(0);
    uint16_t value = 0;
    for (uint16_t number = 0;; number += 2) {
        ask_write(request, number, value);
        ask_read(request + REQUEST, number + 1);
        give(it, request, sizeof request);
        take(it, reply, sizeof reply);
        value = computed(reply + WRITE_REPLY);
    }
}

static void wait_for_silence(void)
{
    const struct timespec silence = {.tv_nsec = SILENCE_NS};
    clock_nanosleep(CLOCK_MONOTONIC, 0, &silence, NULL);
}

static uint16_t checksum(const uint8_t *bytes, size_t length)
{
    uint16_t sum = 0xffff;
    for (size_t i = 0; i < length; i++) {
        sum ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            sum = (uint16_t)(sum & 1 ? sum >> 1 ^ 0xa001 : sum >> 1);
    }
    return sum;
}

static void exchange_rtu(int it, uint8_t function, uint8_t at, uint16_t value, uint8_t *reply, size_t length)
{
    uint8_t request[RTU_REQUEST] = {1, function, 0, at, (uint8_t)(value >> 8), (uint8_t)value};
    uint16_t sum = checksum(request, RTU_REQUEST - 2);
    request[RTU_REQUEST - 2] = (uint8_t)sum;
    request[RTU_REQUEST - 1] = (uint8_t)(sum >> 8);
    give(it, request, RTU_REQUEST);
    take(it, reply, length);
    sum = checksum(reply, length - 2);
    if (reply[length - 2] != (uint8_t)sum || reply[length - 1] != (uint8_t)(sum >> 8))
        give_up("checksum");
    wait_for_silence();
}

static void rtu(const char *path)
{
    uint8_t reply[RTU_READ_REPLY];
    int it = open(path, O_RDWR | O_NOCTTY);
    if (it < 0)
        give_up(path);
    /* Without this, the kernel ends each silence 50 µs late. */
    prctl(PR_SET_TIMERSLACK, 1);
    for (;;) {
        exchange_rtu(it, 4, 0, REGISTERS, reply, RTU_READ_REPLY);
        uint16_t value = compute((uint16_t)(reply[3] << 8 | reply[4]), (uint16_t)(reply[5] << 8 | reply[6]));
        exchange_rtu(it, 6, AT, value, reply, RTU_WRITE_REPLY);
    }
}

static modbus_t *open_modbus_rtu(const char *path)
{
    modbus_t *it = modbus_new_rtu(path, BAUD, 'N', 8, 1);
    if (!it || modbus_set_slave(it, 1) || modbus_set_response_timeout(it, 2, 0) || modbus_connect(it))
        give_up(path);
    return it;
}

static modbus_t *open_modbus(int device)
{
    char text[32];
    address(device, text, sizeof text);
    modbus_t *it = modbus_new_tcp(text, port);
    if (!it || modbus_set_slave(it, 1) || modbus_set_response_timeout(it, 2, 0) || modbus_connect(it))
        give_up(text);
    return it;
}

static void one_loop(modbus_t *it)
{
    uint16_t registers[REGISTERS];
    if (modbus_read_input_registers(it, 0, REGISTERS, registers) != REGISTERS)
        give_up("modbus_read_input_registers");
    if (keeps_silence)
        wait_for_silence();
    if (!reads_only && modbus_write_register(it, AT, compute(registers[0], registers[1])) != 1)
        give_up("modbus_write_register");
    if (keeps_silence)
        wait_for_silence();
}

static void *modbus_thread(void *it)
{
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (;;) {
        one_loop(it);
        next.tv_nsec += period_ms % 1000 * 1000000L;
        next.tv_sec += period_ms / 1000 + next.tv_nsec / 1000000000L;
        next.tv_nsec %= 1000000000L;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    }
    return NULL;
}

static void threads(int devices)
{
    pthread_attr_t small;
    pthread_attr_init(&small);
    pthread_attr_setstacksize(&small, 64 * 1024);
    for (int device = 0; device < devices; device++) {
        pthread_t thread;
        if (pthread_create(&thread, &small, modbus_thread, open_modbus(device)))
            give_up("pthread_create");
    }
    pause();
}

static void sockets(int devices)
{
    int queue = epoll_create1(0), timer = timerfd_create(CLOCK_MONOTONIC, 0);
    int *its = calloc((size_t)devices, sizeof *its);
    struct itimerspec every = {.it_interval = {period_ms / 1000, period_ms % 1000 * 1000000L}, .it_value = {0, 1}};
    struct epoll_event event = {.events = EPOLLIN, .data.u32 = UINT32_MAX}, events[64];
    uint8_t request[REQUEST], reply[READ_REPLY];
    timerfd_settime(timer, 0, &every, NULL);
    epoll_ctl(queue, EPOLL_CTL_ADD, timer, &event);
    for (int device = 0; device < devices; device++) {
        event.data.u32 = (uint32_t)device;
        its[device] = open_socket(device);
        epoll_ctl(queue, EPOLL_CTL_ADD, its[device], &event);
    }
    for (uint16_t number = 0;; number++) {
        int count = epoll_wait(queue, events, 64, -1);
        for (int i = 0; i < count; i++) {
            if (events[i].data.u32 == UINT32_MAX) {
                uint64_t ticks;
                if (read(timer, &ticks, sizeof ticks) < 0)
                    give_up("timer");
                ask_read(request, number);
                for (int device = 0; device < devices; device++)
                    give(its[device], request, REQUEST);
                continue;
            }
            int it = its[events[i].data.u32];
            if (read(it, reply, sizeof reply) <= 0)
                give_up("read");
            if (reply[7] == 4 && !reads_only) {
                ask_write(request, number, computed(reply));
                give(it, request, REQUEST);
            }
        }
    }
}

int main(int count, char **words)
{
    if (count < 3)
        return 2;
    const char *mode = words[1];
    int devices = count > 3 ? atoi(words[3]) : 1;
    port = atoi(words[2]);
    period_ms = count > 4 ? atoi(words[4]) : 0;
    reads_only = count > 5 ? atoi(words[5]) : 0;
    keeps_silence = !strcmp(mode, "libmodbus-rtu-silent");
    if (!strcmp(mode, "ping-pong"))
        ping_pong();
    else if (!strcmp(mode, "pipelined"))
        pipelined();
    else if (!strcmp(mode, "libmodbus"))
        for (modbus_t *it = open_modbus(0);;)
            one_loop(it);
    else if (!strcmp(mode, "rtu"))
        rtu(words[2]);
    else if (!strcmp(mode, "libmodbus-rtu") || keeps_silence)
        for (modbus_t *it = open_modbus_rtu(words[2]);;)
            one_loop(it);
    else if (!strcmp(mode, "sockets"))
        sockets(devices);
    else if (!strcmp(mode, "threads"))
        threads(devices);
    return 2;
}
