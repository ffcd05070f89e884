/* A machine's Modbus TCP devices as libmodbus serves them, for tests of the gateway.
 *
 * Prints `listening PORT`. Then, line by line from stdin:
 *   set UNIT TABLE ADDRESS WORD...   answers `> ok`
 *   get UNIT TABLE ADDRESS COUNT     answers `> WORD...`
 * TABLE is input, holding or discrete. libmodbus answers every unit from one set of registers, so that UNIT is read
 * and not used. Ends with its stdin.
 */
#include <errno.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

enum { REGISTERS = 200, CLIENTS = 16 };

static modbus_mapping_t *map;

static int listen_anywhere(int *port)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;
    int listener = socket(AF_INET, SOCK_STREAM, 0);
    if (listener < 0 || bind(listener, (struct sockaddr *)&at, sizeof at) || listen(listener, CLIENTS)
        || getsockname(listener, (struct sockaddr *)&at, &length))
        return -1;
    *port = ntohs(at.sin_port);
    return listener;
}

static int *numbers(char *rest, int *count)
{
    static int found[REGISTERS];
    *count = 0;
    for (char *word = strtok(rest, " \n"); word && *count < REGISTERS; word = strtok(NULL, " \n"))
        found[(*count)++] = atoi(word);
    return found;
}

static void answer(char *line)
{
    char verb[8], table[16];
    int unit, address, at, count;
    if (sscanf(line, "%7s %d %15s %d %n", verb, &unit, table, &address, &at) != 4) {
        puts("> what?");
        return;
    }
    int *given = numbers(line + at, &count);
    int is_bits = !strcmp(table, "discrete");
    uint16_t *words = strcmp(table, "input") ? map->tab_registers : map->tab_input_registers;
    if (!strcmp(verb, "set")) {
        for (int i = 0; i < count; i++) {
            if (is_bits)
                map->tab_input_bits[address + i] = given[i] != 0;
            else
                words[address + i] = (uint16_t)given[i];
        }
        puts("> ok");
    } else {
        fputs(">", stdout);
        for (int i = 0; i < given[0]; i++)
            printf(" %d", is_bits ? map->tab_input_bits[address + i] : words[address + i]);
        puts("");
    }
}

int main(void)
{
    int port, clients[CLIENTS], used = 0;
    int listener = listen_anywhere(&port);
    modbus_t *modbus = modbus_new_tcp("127.0.0.1", 0);
    map = modbus_mapping_new(REGISTERS, REGISTERS, REGISTERS, REGISTERS);
    if (listener < 0 || !modbus || !map) {
        fprintf(stderr, "cannot serve: %s\n", strerror(errno));
        return 1;
    }
    setvbuf(stdout, NULL, _IOLBF, 0);
    printf("listening %d\n", port);
    for (;;) {
        fd_set ready;
        FD_ZERO(&ready);
        FD_SET(STDIN_FILENO, &ready);
        FD_SET(listener, &ready);
        int highest = listener;
        for (int i = 0; i < used; i++) {
            FD_SET(clients[i], &ready);
            highest = clients[i] > highest ? clients[i] : highest;
        }
        if (select(highest + 1, &ready, NULL, NULL, NULL) < 0)
            return 1;
        if (FD_ISSET(STDIN_FILENO, &ready)) {
            /* One whole line at a time: the test waits for each answer before it writes the next. */
            char line[4096];
            ssize_t length = read(STDIN_FILENO, line, sizeof line - 1);
            if (length <= 0)
                return 0;
            line[length] = 0;
            answer(line);
        }
        for (int i = 0; i < used; i++) {
            if (!FD_ISSET(clients[i], &ready))
                continue;
            uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
            modbus_set_socket(modbus, clients[i]);
            int length = modbus_receive(modbus, query);
            if (length < 0) {
                close(clients[i]);
                clients[i--] = clients[--used];
                /* What was moved here is looked at in the next round. */
                break;
            }
            if (length > 0)
                modbus_reply(modbus, query, length, map);
        }
        if (FD_ISSET(listener, &ready)) {
            int client = accept(listener, NULL, NULL);
            if (client >= 0 && used < CLIENTS)
                clients[used++] = client;
            else if (client >= 0)
                close(client);
        }
    }
}
