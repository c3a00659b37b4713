// C++ interface of linkwatch (C++17, header only) over the C interface in linkwatch.h.
//
// Objects own what they hold, and can be moved but not copied. Failures are exceptions of the type
// linkwatch::Error. No object is thread-safe: use it in one thread at a time.

#ifndef LINKWATCH_HPP
#define LINKWATCH_HPP

#include "linkwatch.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace linkwatch {

// A failure, described in words.
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

enum class Basis : std::uint32_t {
  Polyline = LW_POLYLINE,
  CatmullRom = LW_CATMULL_ROM,
  BSpline = LW_B_SPLINE,
  Bezier = LW_BEZIER,
};

// Verdict on a frame, or another message of the watcher: the members of lw_verdict.
struct Verdict : lw_verdict {
  Verdict() : lw_verdict() { verdict = LW_NOT_VERIFIED; }
  // True if this is a verdict, and every linking number was proven to be the expected one.
  bool intact() const { return kind == LW_VERDICT && verdict == LW_INTACT; }
  // The verdict and its first findings as a sentence.
  std::string words() const { return text; }
  // Last frame that is known to be intact.
  std::optional<std::uint64_t> intact_frame() const {
    return last_intact == LW_NO_FRAME ? std::nullopt : std::optional(last_intact);
  }
  // Largest proven fraction of the step from that frame without a pull-through, from 0 to 1.
  std::optional<double> safe_share() const {
    return std::isnan(safe_fraction) ? std::nullopt : std::optional(safe_fraction);
  }
};

namespace detail {

[[noreturn]] inline void fail() { throw Error(lw_last_error()); }

inline lw_status check(lw_status status) {
  if (status == LW_ERROR) fail();
  return status;
}

template <class T> T *check(T *made) {
  if (!made) fail();
  return made;
}

template <class T> constexpr std::uint32_t precision() {
  static_assert(std::is_same_v<T, float> || std::is_same_v<T, double>, "float or double");
  return std::is_same_v<T, float> ? LW_FLOAT : LW_DOUBLE;
}

template <class T> lw_frame frame(Basis basis, const std::vector<std::int32_t> &counts,
                                  const std::vector<T> &positions) {
  std::size_t points = 0;
  for (std::int64_t count : counts) points += static_cast<std::size_t>(count < 0 ? -count : count);
  if (positions.size() != 3 * points)
    throw Error(std::to_string(positions.size()) + " coordinates, expected 3 for each of " +
                std::to_string(points) + " points");
  return {static_cast<std::uint32_t>(basis), precision<T>(), counts.size(), counts.data(),
          positions.data()};
}

template <class T, void (*FREE)(T *)> struct Free {
  void operator()(T *object) const { FREE(object); }
};
template <class T, void (*FREE)(T *)> using Owned = std::unique_ptr<T, Free<T, FREE>>;

// Names and radii of curves, as the C interface takes them; either may be empty.
struct Labels {
  Labels(std::size_t curves, const std::vector<std::string> &names, const std::vector<float> &radii)
      : radii(radii.empty() ? nullptr : radii.data()) {
    if ((!names.empty() && names.size() != curves) || (!radii.empty() && radii.size() != curves))
      throw Error("expected a name and a radius for each curve, or none");
    for (const std::string &name : names) pointers.push_back(name.c_str());
  }
  const char *const *names() const { return pointers.empty() ? nullptr : pointers.data(); }

  const float *radii;

private:
  std::vector<const char *> pointers;
};

// Returns the struts of an object of the C interface, which is freed.
inline std::vector<lw_strut> list(lw_struts *made) {
  const Owned<lw_struts, lw_struts_free> found(check(made));
  std::size_t count = 0;
  const lw_strut *first = lw_struts_list(found.get(), &count);
  return std::vector<lw_strut>(first, first + count);
}

} // namespace detail

// Simulator's end of the bus: frames of coordinates of the type T, float or double.
template <class T> class Client {
public:
  // Opens a service and declares the curves of every frame: the number of control points of each
  // curve, negative if the curve is closed.
  Client(const std::string &service, const std::vector<std::int32_t> &counts,
         Basis basis = Basis::Polyline, lw_options options = {})
      : client(detail::check(lw_open(service.c_str(), &options))), basis(basis) {
    describe(counts, {});
  }

  // Declares other curves from the next frame on. They need names, as those before: the watcher
  // compares curves by name. `radii` may be empty. Without an earlier frame, names may be empty
  // too. The basis stays as it is unless another one is given.
  void describe(const std::vector<std::int32_t> &counts, const std::vector<std::string> &names,
                const std::vector<float> &radii = {}, std::optional<Basis> other = std::nullopt) {
    const detail::Labels labels(counts.size(), names, radii);
    const Basis next = other.value_or(basis);
    detail::check(lw_describe_labelled(open(), static_cast<std::uint32_t>(next),
                                       detail::precision<T>(), counts.data(), counts.size(),
                                       labels.names(), labels.radii));
    basis = next;
    coordinates = 0;
    for (std::int64_t count : counts)
      coordinates += 3 * static_cast<std::size_t>(count < 0 ? -count : count);
  }

  // Sets the time step of the simulator in seconds, for the recording; 0 if it is unknown.
  void set_time_step(double seconds) { detail::check(lw_set_time_step(open(), seconds)); }

  // Sets the periodic cell of later frames: three vectors, one after the other, and a corner. A
  // vector of zeros stands for a direction without repetition.
  void set_cell(const std::array<double, 9> &vectors, const std::array<double, 3> &corner = {}) {
    detail::check(lw_set_cell(open(), vectors.data(), corner.data()));
  }

  // Number of coordinates of a frame: three for each control point.
  std::size_t size() const { return coordinates; }

  // Returns shared memory for the next frame: size() numbers, `x y z x y z ..`. Write all of it,
  // then call publish().
  T *begin(double time) {
    if constexpr (std::is_same_v<T, float>)
      return detail::check(lw_begin_float(open(), time));
    else
      return detail::check(lw_begin_double(open(), time));
  }

  // Publishes the frame that was begun. Returns its number. Never waits.
  std::uint64_t publish() {
    std::uint64_t seq = 0;
    detail::check(lw_publish(open(), &seq));
    return seq;
  }

  // Returns the next verdict, if there is one. Never waits.
  std::optional<Verdict> poll() {
    Verdict verdict;
    if (detail::check(lw_poll(open(), &verdict)) != LW_OK) return std::nullopt;
    return verdict;
  }

  // Waits for the verdict on a frame. Returns nothing if there is none in time, if the frame was
  // skipped, or if the watcher left: lw_last_error() says which. The frame is not known to be
  // intact then.
  std::optional<Verdict> wait(std::uint64_t seq, double seconds) {
    Verdict verdict;
    if (detail::check(lw_wait(open(), seq, seconds, &verdict)) != LW_OK) return std::nullopt;
    return verdict;
  }

  // Waits until a watcher has seen this session. Returns false if none came in time.
  bool wait_for_watcher(double seconds) {
    return detail::check(lw_wait_for_watcher(open(), seconds)) == LW_OK;
  }

  // Returns the first verdict that asks the simulator to stop, if one was read. Verdicts on the
  // last frames may arrive only with finish(), whose result repeats the last abort.
  std::optional<Verdict> aborted() {
    Verdict verdict;
    if (!lw_aborted(open(), &verdict)) return std::nullopt;
    return verdict;
  }

  // Clears the abort after a roll back: the next frame does not continue the last one.
  void resume() { detail::check(lw_resume(open())); }

  // Accepts the present state as the new baseline: the watcher expects the linking numbers of the
  // next frame from then on. Clears the abort.
  void accept() { detail::check(lw_accept(open())); }

  // Marks the next frame as not continuing the previous one.
  void cut() { detail::check(lw_cut(open())); }

  // Returns the seconds since the last message of the watcher; nothing if there is no watcher.
  std::optional<double> silent_for() {
    const double seconds = lw_silent_for(open());
    return seconds < 0 ? std::nullopt : std::optional(seconds);
  }

  // Ends the session and waits for the last message of the watcher: check its `abort`. The client
  // cannot be used afterwards. Without this call, the watcher is informed that the session ended
  // early.
  std::optional<Verdict> finish(double seconds) {
    Verdict last;
    if (detail::check(lw_finish((open(), client.release()), seconds, &last)) != LW_OK)
      return std::nullopt;
    return last;
  }

private:
  lw_client *open() const {
    if (!client) throw Error("the session has ended; open another client");
    return client.get();
  }

  detail::Owned<lw_client, lw_close> client;
  Basis basis;
  std::size_t coordinates = 0;
};

// All linking numbers of a frame.
class Certificate {
public:
  explicit Certificate(lw_certificate *made) : certificate(detail::check(made)) {}

  // Reads a certificate from a file.
  static Certificate read(const std::string &path) {
    return Certificate(lw_certificate_read(path.c_str()));
  }

  // Writes the certificate to a file.
  void write(const std::string &path) const {
    detail::check(lw_certificate_write(certificate.get(), path.c_str()));
  }

  // Returns the linking numbers that are not 0, sorted by pair.
  std::vector<lw_link> links() const {
    std::size_t count = 0;
    const lw_link *first = lw_certificate_links(get(), &count);
    return std::vector<lw_link>(first, first + count);
  }

  // Returns the linking numbers with periodic images that are not 0, sorted.
  std::vector<lw_image_link> images() const {
    std::size_t count = 0;
    const lw_image_link *first = lw_certificate_images(get(), &count);
    return std::vector<lw_image_link>(first, first + count);
  }

  // Returns the number of pairs and curves without a linking number.
  std::size_t undefined() const { return lw_certificate_undefined(get()); }

  lw_certificate *get() const {
    if (!certificate) throw Error("the certificate was moved");
    return certificate.get();
  }

private:
  detail::Owned<lw_certificate, lw_certificate_free> certificate;
};

// Nine numbers, as described at lw_certify, or nothing.
using Cell = std::optional<std::array<double, 9>>;

// Computes the linking numbers of all pairs of closed curves, exactly; in a cell, with all images
// of the curves.
template <class T>
Certificate certify(const std::vector<std::int32_t> &counts, const std::vector<T> &positions,
                    const Cell &cell = {}, Basis basis = Basis::Polyline) {
  const lw_frame frame = detail::frame(basis, counts, positions);
  return Certificate(lw_certify(&frame, cell ? cell->data() : nullptr));
}

// Returns the largest proven fraction of the step between two frames without a pull-through.
template <class T>
double safe_fraction(const std::vector<std::int32_t> &counts, const std::vector<T> &before,
                     const std::vector<T> &after, Basis basis = Basis::Polyline) {
  const lw_frame frames[] = {detail::frame(basis, counts, before),
                             detail::frame(basis, counts, after)};
  const double fraction = lw_safe_fraction(&frames[0], &frames[1]);
  if (fraction < 0) detail::fail();
  return fraction;
}

// Measures how sharply curves bend and how close they come, to all images in a cell.
template <class T>
lw_thickness_values thickness(const std::vector<std::int32_t> &counts,
                              const std::vector<T> &positions, const Cell &cell = {},
                              Basis basis = Basis::Polyline, double stiffness = 1) {
  const lw_frame frame = detail::frame(basis, counts, positions);
  lw_thickness_values values{};
  detail::check(lw_thickness(&frame, cell ? cell->data() : nullptr, stiffness, &values));
  return values;
}

// Returns all struts up to a length, the shortest first; in a cell, each one once.
template <class T>
std::vector<lw_strut> struts(const std::vector<std::int32_t> &counts,
                             const std::vector<T> &positions, double longest,
                             const Cell &cell = {}, Basis basis = Basis::Polyline) {
  const lw_frame frame = detail::frame(basis, counts, positions);
  return detail::list(lw_struts_up_to(&frame, cell ? cell->data() : nullptr, longest));
}

// Computes linking number, twist and writhe of the ribbon between two curves, such as the strands
// of DNA. For the pairing of their vertices see lw_ribbon.
template <class T>
lw_ribbon_values ribbon(const std::vector<std::int32_t> &counts, const std::vector<T> &positions,
                        std::size_t first = 0, std::size_t second = 1,
                        const std::string &pairing = "auto", bool axis_first = false,
                        double tolerance = 1e-4) {
  const lw_frame frame = detail::frame(Basis::Polyline, counts, positions);
  lw_ribbon_values values{};
  detail::check(
      lw_ribbon(&frame, first, second, pairing.c_str(), axis_first, tolerance, &values));
  return values;
}

// Verifies the frames of one simulation in process, against the first one or against a baseline.
class Session {
public:
  explicit Session(std::vector<std::int32_t> counts, Basis basis = Basis::Polyline,
                    lw_session_options options = {})
      : session(detail::check(lw_session_new(&options))), counts(std::move(counts)),
        basis(basis) {}

  // Declares other curves from the next frame on, as Client::describe does. `radii` are needed if
  // the options have some.
  void describe(const std::vector<std::int32_t> &others, const std::vector<std::string> &names,
                const std::vector<float> &radii = {}, std::optional<Basis> other = std::nullopt) {
    const detail::Labels labels(others.size(), names, radii);
    detail::check(lw_session_describe(session.get(), labels.names(), labels.radii, others.size()));
    basis = other.value_or(basis);
    counts = others;
  }

  // Verifies the next frame, at `time` seconds of simulation. An invalid frame is LW_REJECTED.
  template <class T> Verdict step(const std::vector<T> &positions, double time = 0) {
    const lw_frame frame = detail::frame(basis, counts, positions);
    Verdict verdict;
    detail::check(lw_session_step(session.get(), &frame, time, &verdict));
    return verdict;
  }

  // Returns what the frames decided about closed and open curves, a sentence a line; see
  // lw_session_notes.
  std::string notes() {
    const char *text = lw_session_notes(session.get());
    return text ? text : "";
  }

  // Sets the periodic cell of the frames from the next one on, as Client::set_cell does.
  void set_cell(const std::array<double, 9> &vectors, const std::array<double, 3> &corner = {}) {
    detail::check(lw_session_set_cell(session.get(), vectors.data(), corner.data()));
  }

  // Returns the clearance of the last verified frame, if it is measured.
  std::optional<lw_clearance> clearance() const {
    lw_clearance found{};
    if (detail::check(lw_session_clearance(session.get(), &found)) != LW_OK) return std::nullopt;
    return found;
  }

  // Accepts the present state as the new baseline: the linking numbers of the next frame are
  // expected from then on. Before the first frame, this does nothing: a given baseline remains.
  void accept() { detail::check(lw_session_accept(session.get())); }

  // Marks the next frame as not continuing the previous one.
  void cut() { detail::check(lw_session_cut(session.get())); }

private:
  detail::Owned<lw_session, lw_session_free> session;
  std::vector<std::int32_t> counts;
  Basis basis;
};

} // namespace linkwatch

#endif
