/* Flight software in C for shefex_nav: messages by standard input and output. One file, C99 and POSIX.
 *
 *     struct shefex_message in;
 *     while (shefex_receive(&in)) {
 *         if (shefex_is(&in, "ImuBlock")) ... shefex_doubles(&in, SHEFEX_IMU_DTHETA_B, &n) ...
 *         if (shefex_is(&in, "Tick")) { shefex_begin("Estimate"); shefex_put(...); shefex_end(); ... }
 *     }
 *
 * Messages are those of `shefex-nav schema --proto`; a field has the number that it has there. A number, bool
 * or list that is zero or empty may be left out: it is read as such, and need not be written. The machine is
 * taken to be little endian, as almost all are.
 */
#ifndef SHEFEX_FSW_H
#define SHEFEX_FSW_H

#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200112L
#endif
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct shefex_message {
    char name[64];
    unsigned char *body;
    size_t size, room;
};

#define SHEFEX_FORMAT 1 /* of the messages; Start says which */

/* numbers of the fields that navigation wants */
enum {
    SHEFEX_START_FORMAT = 2, SHEFEX_START_START_S = 4, SHEFEX_START_C_IQ = 5, SHEFEX_START_C_RE = 6, SHEFEX_START_EARTH_ANGLE_0 = 7,
    SHEFEX_START_EARTH_RATE = 8, SHEFEX_START_C_BC = 16, SHEFEX_START_L_BA_B = 18,
    SHEFEX_ALIGNMENT_T_VALID_S = 2, SHEFEX_ALIGNMENT_R_I = 3, SHEFEX_ALIGNMENT_V_I = 4,
    SHEFEX_ALIGNMENT_Q_IB = 5,
    SHEFEX_IMU_T_VALID_S = 2, SHEFEX_IMU_DT_S = 4, SHEFEX_IMU_DTHETA_B = 5, SHEFEX_IMU_DV_B = 6,
    SHEFEX_IMU_VALID = 8,
    SHEFEX_GPS_T_VALID_S = 2, SHEFEX_GPS_VALID = 4, SHEFEX_GPS_R_EA_E = 5, SHEFEX_GPS_V_EA_E = 6, SHEFEX_GPS_HORIZONTAL = 12,
    SHEFEX_STAR_T_VALID_S = 3, SHEFEX_STAR_REASON = 5, SHEFEX_STAR_Q_IC = 6, SHEFEX_STAR_P_C = 7,
    SHEFEX_TICK_T_S = 2,
    SHEFEX_ESTIMATE_R_I = 2, SHEFEX_ESTIMATE_V_I = 3, SHEFEX_ESTIMATE_Q_IB = 4, SHEFEX_ESTIMATE_P = 5,
    SHEFEX_ESTIMATE_STAR_AIDED = 9,
    SHEFEX_DONE_T_S = 2
};

static unsigned char shefex_in[1 << 16];
static size_t shefex_in_first, shefex_in_end;

/* More bytes of standard input; for a moment it is asked again and again, because who sleeps is woken late. */
static int shefex_more(void)
{
    static int flags = -1;
    if (flags < 0) {
        flags = fcntl(0, F_GETFL);
        fcntl(0, F_SETFL, flags | O_NONBLOCK);
    }
    for (int asked = 0;; asked++) {
        ssize_t n = read(0, shefex_in, sizeof shefex_in);
        if (n > 0) {
            shefex_in_first = 0;
            shefex_in_end = (size_t)n;
            return 1;
        }
        if (n == 0 || (errno != EAGAIN && errno != EINTR)) return 0;
        if (asked < 500) {
            sched_yield();
        } else {
            struct pollfd wait = {0, POLLIN, 0};
            poll(&wait, 1, -1);
        }
    }
}

static int shefex_bytes(void *into, size_t size)
{
    unsigned char *to = into;
    while (size) {
        if (shefex_in_first == shefex_in_end && !shefex_more()) return 0;
        size_t n = shefex_in_end - shefex_in_first;
        if (n > size) n = size;
        memcpy(to, shefex_in + shefex_in_first, n);
        shefex_in_first += n;
        to += n;
        size -= n;
    }
    return 1;
}

/* The next message; 0 when the simulator has no more. */
static int shefex_receive(struct shefex_message *in)
{
    unsigned char head[5];
    if (!shefex_bytes(head, 5)) return 0;
    uint32_t length;
    memcpy(&length, head, 4);
    size_t n = head[4];
    if (n > 63 || length < 1 + n || !shefex_bytes(in->name, n)) return 0;
    in->name[n] = 0;
    in->size = length - 1 - n;
    if (in->size > in->room) {
        in->room = 2 * in->size;
        in->body = realloc(in->body, in->room);
        if (!in->body) return 0;
    }
    return shefex_bytes(in->body, in->size);
}

static int shefex_is(const struct shefex_message *in, const char *name) { return !strcmp(in->name, name); }

static uint64_t shefex_varint(const unsigned char *data, size_t size, size_t *at)
{
    uint64_t value = 0;
    for (int shift = 0; *at < size && shift < 64; shift += 7) {
        unsigned char byte = data[(*at)++];
        value |= (uint64_t)(byte & 127) << shift;
        if (byte < 128) break;
    }
    return value;
}

/* Where a field begins, and how many bytes it has; NULL without it. A whole number is put into *value. */
static const unsigned char *shefex_field(const struct shefex_message *in, int number, size_t *bytes,
                                         uint64_t *value)
{
    size_t at = 0;
    while (at < in->size) {
        uint64_t tag = shefex_varint(in->body, in->size, &at);
        size_t begin, length;
        uint64_t found = 0;
        switch (tag & 7) {
        case 0: begin = at; found = shefex_varint(in->body, in->size, &at); length = at - begin; break;
        case 1: begin = at; length = 8; at += 8; break;
        case 5: {
            uint32_t four = 0;
            begin = at;
            length = 4;
            at += 4;
            if (at <= in->size) memcpy(&four, in->body + begin, 4);
            found = four;
            break;
        }
        case 2: length = shefex_varint(in->body, in->size, &at); begin = at; at += length; break;
        default: return NULL;
        }
        if (at > in->size) return NULL;
        if ((int)(tag >> 3) == number) {
            *bytes = length;
            if (value) *value = found;
            return in->body + begin;
        }
    }
    return NULL;
}

/* Numbers of a field, at most `room` of them; the rest is zero. -> how many there are */
static int shefex_doubles(const struct shefex_message *in, int number, double *into, int room)
{
    size_t bytes = 0;
    const unsigned char *from = shefex_field(in, number, &bytes, NULL);
    memset(into, 0, sizeof(double) * room);
    if (!from) return 0;
    int n = (int)(bytes / sizeof(double));
    if (n > room) n = room;
    memcpy(into, from, sizeof(double) * n);
    return n;
}

static double shefex_double(const struct shefex_message *in, int number)
{
    double value;
    shefex_doubles(in, number, &value, 1);
    return value;
}

/* A bool, an enumeration or a whole number. */
static int shefex_int(const struct shefex_message *in, int number)
{
    size_t bytes;
    uint64_t value = 0;
    shefex_field(in, number, &bytes, &value);
    return (int)value;
}

/* Messages that are sent: begin, put fields, end; `shefex_send` lets them go. */
static unsigned char shefex_out[1 << 16];
static size_t shefex_used, shefex_first;

static void shefex_begin(const char *name)
{
    size_t n = strlen(name);
    shefex_first = shefex_used;
    shefex_out[shefex_first + 4] = (unsigned char)n;
    memcpy(shefex_out + shefex_first + 5, name, n);
    shefex_used += 5 + n;
}

static void shefex_put_varint(uint64_t value)
{
    for (; value > 127; value >>= 7) shefex_out[shefex_used++] = (unsigned char)(value | 128);
    shefex_out[shefex_used++] = (unsigned char)value;
}

static void shefex_put(int number, const double *values, int n)
{
    shefex_put_varint((uint64_t)number << 3 | 2);
    shefex_put_varint(n * sizeof(double));
    memcpy(shefex_out + shefex_used, values, n * sizeof(double));
    shefex_used += n * sizeof(double);
}

static void shefex_put_double(int number, double value)
{
    shefex_put_varint((uint64_t)number << 3 | 1);
    memcpy(shefex_out + shefex_used, &value, sizeof value);
    shefex_used += sizeof value;
}

static void shefex_put_int(int number, int value)
{
    shefex_put_varint((uint64_t)number << 3);
    shefex_put_varint((uint64_t)value);
}

static void shefex_end(void)
{
    uint32_t length = (uint32_t)(shefex_used - shefex_first - 4);
    memcpy(shefex_out + shefex_first, &length, 4);
}

static int shefex_send(void)
{
    for (size_t done = 0; done < shefex_used;) {
        ssize_t n = write(1, shefex_out + done, shefex_used - done);
        if (n < 0 && errno == EAGAIN) {
            struct pollfd wait = {1, POLLOUT, 0};
            poll(&wait, 1, -1);
        } else if (n < 0 && errno != EINTR) {
            return 0;
        }
        if (n > 0) done += (size_t)n;
    }
    shefex_used = 0;
    return 1;
}

#endif
