// The Python module _entropy: plane codecs 0, 4 and 5. Planes are (height, width) arrays of uint16.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "context_codec.hpp"
#include "numbers.hpp"
#include "planes.hpp"
#include "ranges_codec.hpp"
#include "rans.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T, int Axes>
using Array = nb::ndarray<T, nb::ndim<Axes>, nb::c_contig, nb::device::cpu>;
using Samples = Array<const std::uint16_t, 2>;
using OutSamples = Array<std::uint16_t, 2>;
using Errors = Array<std::int32_t, 2>;
using Prior = Array<const std::uint16_t, 3>;
using Columns = std::optional<Samples>;
using Around = Array<std::uint32_t, 2>;

constexpr std::size_t kMaxSide = 65535, kMaxPrior = 255;

void require(bool condition, const char *message) {
    if (!condition) throw nb::value_error(message);
}

// Checks the arrays of a plane, its prior planes and the columns to follow (null: not guided).
template <class A>
gsvr::Plane plane_of(const A &samples, int bits, const Prior &prior, const Columns &columns) {
    const std::size_t height = samples.shape(0), width = samples.shape(1);
    require(width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide,
            "a plane has 1 to 65535 rows and columns");
    require(bits >= 1 && bits <= 16, "a plane has 1 to 16 bits");
    require(prior.shape(0) <= kMaxPrior && prior.shape(1) == height && prior.shape(2) == width,
            "prior planes must be at most 255 and have the size of the plane");
    if (columns) {
        require(columns->shape(0) == height && columns->shape(1) == width,
                "columns must have the size of the plane");
        const std::uint16_t *begin = columns->data();
        require(*std::max_element(begin, begin + columns->size()) < width,
                "a column is out of range");
    }
    return {
        static_cast<int>(width),          static_cast<int>(height),           bits, prior.data(),
        static_cast<int>(prior.shape(0)), columns ? columns->data() : nullptr};
}

nb::bytes bytes_of(const std::vector<std::uint8_t> &data) {
    return nb::bytes(data.data(), data.size());
}

const std::uint8_t *data_of(const nb::bytes &data) {
    return static_cast<const std::uint8_t *>(data.data());
}

void follow(Samples guide, OutSamples columns) {
    require(guide.size() && guide.shape(1) <= kMaxSide && guide.shape(0) == columns.shape(0) &&
                guide.shape(1) == columns.shape(1),
            "columns must have the size of the guide");
    gsvr::follow(static_cast<int>(guide.shape(1)), static_cast<int>(guide.shape(0)), guide.data(),
                 columns.data());
}

void predict(Samples samples, int bits, Prior prior, Columns columns,
             const gsvr::Predictor &predictor, Errors errors, Around around) {
    const auto plane = plane_of(samples, bits, prior, columns);
    require(errors.size() == samples.size() && around.size() == samples.size(),
            "errors and around must have the size of the plane");
    gsvr::predict(plane, predictor, samples.data(), errors.data(), around.data());
}

double measure(Errors errors, Around around, const gsvr::Coding &coding) {
    require(errors.size() == around.size(), "errors and around must have one size");
    return gsvr::measure(errors.data(), around.data(), errors.size(), coding);
}

nb::bytes encode_context(Samples samples, int bits, Prior prior, Columns columns,
                         const gsvr::Predictor &predictor, const gsvr::Coding &coding) {
    const auto plane = plane_of(samples, bits, prior, columns);
    return bytes_of(gsvr::encode_context(plane, predictor, coding, samples.data()));
}

nb::bytes encode_ranges(Samples samples) {
    require(samples.size() && samples.shape(0) <= kMaxSide && samples.shape(1) <= kMaxSide,
            "a plane has 1 to 65535 rows and columns");
    return bytes_of(gsvr::encode_ranges(static_cast<int>(samples.shape(1)),
                                        static_cast<int>(samples.shape(0)), samples.data()));
}

// Codec, bits, offset and bytes of a plane, the number of its stack, and its place there.
using CodedPlane = std::tuple<int, int, std::size_t, std::size_t, std::size_t, int>;
// The planes of a grid, and whether the first guides the others.
using Stack = std::tuple<Array<std::uint16_t, 3>, bool>;

gsvr::PlaneStack stack_of(const Stack &stack) {
    const auto &[samples, guided] = stack;
    require(samples.shape(0) <= kMaxPrior && samples.shape(1) >= 1 && samples.shape(2) >= 1 &&
                samples.shape(1) <= kMaxSide && samples.shape(2) <= kMaxSide,
            "a stack has at most 255 planes of 1 to 65535 rows and columns");
    return {samples.data(),
            static_cast<int>(samples.shape(0)),
            static_cast<int>(samples.shape(2)),
            static_cast<int>(samples.shape(1)),
            guided,
            {}};
}

std::optional<std::pair<std::size_t, std::string>> decode_planes(
    nb::bytes data, const std::vector<CodedPlane> &planes, const std::vector<Stack> &stacks) {
    std::vector<gsvr::PlaneStack> found;
    for (const Stack &stack : stacks) found.push_back(stack_of(stack));
    for (const auto &[codec, bits, offset, size, stack, place] : planes) {
        require(bits >= 1 && bits <= 16, "a plane has 1 to 16 bits");
        require(offset <= data.size() && size <= data.size() - offset, "a plane is out of range");
        require(stack < found.size() && place >= 0 && place < found[stack].count,
                "a plane has no place");
    }
    const std::uint8_t *bytes = data_of(data);
    nb::gil_scoped_release release;
    for (std::size_t i = 0; i < planes.size(); ++i) {
        const auto &[codec, bits, offset, size, stack, place] = planes[i];
        try {
            gsvr::decode_plane({codec, bits, bytes + offset, size, place}, found[stack]);
        } catch (const gsvr::Corrupt &error) {
            return std::pair{i, std::string(error.what())};
        }
    }
    return {};
}

using Numbers = Array<std::uint8_t, 1>;

void unpack_numbers(nb::bytes data, Array<const std::int8_t, 1> bits, Numbers out) {
    require(out.size() == bits.size(), "as many numbers as counts of bits");
    std::size_t sum = 0;
    for (std::size_t i = 0; i < bits.size(); ++i) {
        require(bits.data()[i] >= 0 && bits.data()[i] <= 8, "a number has 0 to 8 bits");
        sum += static_cast<std::size_t>(bits.data()[i]);
    }
    require(sum <= 8 * data.size(), "fewer bits than the numbers have");
    gsvr::unpack_numbers(data_of(data), data.size(), bits.data(), bits.size(), out.data());
}

}  // namespace

NB_MODULE(_entropy, m) {
    m.doc() = "Plane codecs 0, 4 and 5 (spec/gsvr.md).";
    nb::class_<gsvr::Predictor>(m, "Predictor")
        .def(
            "__init__",
            [](gsvr::Predictor *self, const std::vector<std::pair<int, int>> &terms, int bias,
               bool guided, const std::array<int, gsvr::kNeighbours> &weights) {
                new (self) gsvr::Predictor{{}, bias, guided, weights};
                for (const auto &[plane, weight] : terms) self->terms.push_back({plane, weight});
            },
            "terms"_a, "bias"_a, "guided"_a, "weights"_a);
    nb::class_<gsvr::Coding>(m, "Coding")
        .def(
            "__init__",
            [](gsvr::Coding *self, unsigned direct, unsigned top,
               const std::vector<std::uint32_t> &thresholds) {
                new (self) gsvr::Coding{direct, top, thresholds};
            },
            "direct"_a, "top"_a, "thresholds"_a);
    m.def("follow", &follow, "guide"_a, "columns"_a);
    m.def("predict", &predict, "samples"_a, "bits"_a, "prior"_a, "columns"_a.none(), "predictor"_a,
          "errors"_a, "around"_a);
    m.def("measure", &measure, "errors"_a, "around"_a, "coding"_a);
    m.def("encode_context", &encode_context, "samples"_a, "bits"_a, "prior"_a, "columns"_a.none(),
          "predictor"_a, "coding"_a);
    m.def("encode_ranges", &encode_ranges, "samples"_a);
    m.def("decode_planes", &decode_planes, "data"_a, "planes"_a, "stacks"_a);
    m.def("unpack_numbers", &unpack_numbers, "data"_a, "bits"_a, "out"_a);
}
