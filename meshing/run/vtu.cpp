#include <vtkCellArray.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkIdTypeArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <stdexcept>

#include "meshing/base/files.h"
#include "meshing/run/record.h"

namespace testbed::meshing {
namespace {

vtkNew<vtkDoubleArray> array_of(const std::string& name, const Eigen::MatrixXd& values) {
  vtkNew<vtkDoubleArray> array;
  array->SetName(name.c_str());
  array->SetNumberOfComponents(static_cast<int>(values.rows()));
  array->SetNumberOfTuples(values.cols());
  std::copy(values.data(), values.data() + values.size(), array->GetPointer(0));
  return array;
}

}  // namespace

std::string write_vtu(const std::filesystem::path& file, const Eigen::Matrix3Xd& points,
                      const std::vector<CellBlock>& cells, const std::vector<Field>& point_fields,
                      const std::map<std::string, double>& field_data, const std::vector<int>& numbers) {
  if (!points.allFinite())
    throw std::runtime_error(file.string() + ": a position is not finite, nothing written");
  vtkNew<vtkUnstructuredGrid> grid;
  vtkNew<vtkPoints> vtk_points;
  vtk_points->SetData(array_of("points", points));
  grid->SetPoints(vtk_points);

  vtkNew<vtkUnsignedCharArray> types;
  vtkNew<vtkCellArray> vtk_cells;
  for (const CellBlock& block : cells)
    for (int c = 0; c < block.nodes.cols(); ++c) {
      types->InsertNextValue(static_cast<unsigned char>(block.vtk_type));
      vtk_cells->InsertNextCell(static_cast<int>(block.nodes.rows()));
      for (int k = 0; k < block.nodes.rows(); ++k) vtk_cells->InsertCellPoint(block.nodes(k, c));
    }
  grid->SetCells(types, vtk_cells);

  for (const Field& field : point_fields) {
    if (!field.values.allFinite())
      throw std::runtime_error(file.string() + ": field " + field.name + " is not finite, nothing written");
    grid->GetPointData()->AddArray(array_of(field.name, field.values));
  }
  vtkNew<vtkIdTypeArray> node_id;
  node_id->SetName("node_id");
  node_id->SetNumberOfTuples(points.cols());
  std::iota(node_id->GetPointer(0), node_id->GetPointer(0) + points.cols(), 0);
  std::copy(numbers.begin(), numbers.end(), node_id->GetPointer(0));
  grid->GetPointData()->AddArray(node_id);
  for (const auto& [name, value] : field_data) {
    if (!std::isfinite(value))
      throw std::runtime_error(file.string() + ": " + name + " is not finite, nothing written");
    grid->GetFieldData()->AddArray(array_of(name, Eigen::MatrixXd::Constant(1, 1, value)));
  }

  vtkNew<vtkXMLUnstructuredGridWriter> writer;
  writer->WriteToOutputStringOn();  // VTK reports a full disk or a missing folder to stderr only
  writer->SetInputData(grid);
  writer->SetDataModeToAppended();
  writer->EncodeAppendedDataOff();
  writer->SetCompressorTypeToZLib();  // which meshio reads, too
  writer->SetCompressionLevel(1);     // higher ones take longer and save a hundredth
  if (!writer->Write()) throw std::runtime_error(file.string() + ": cannot be made by VTK");
  std::string bytes = writer->GetOutputString();
  write_file(file, bytes);
  return bytes;
}

std::string write_pvtu(const std::filesystem::path& file, const std::vector<std::string>& pieces,
                       const std::vector<Field>& point_fields) {
  std::ostringstream list;
  const auto add = [&](const std::string& name, const char* type, Eigen::Index n) {
    list << "      <PDataArray type=\"" << type << "\" Name=\"" << name << "\" NumberOfComponents=\"" << n
         << "\"/>\n";
  };
  list << "<?xml version=\"1.0\"?>\n<VTKFile type=\"PUnstructuredGrid\" version=\"0.1\">\n"
          "  <PUnstructuredGrid GhostLevel=\"0\">\n    <PPointData>\n";
  for (const Field& field : point_fields) add(field.name, "Float64", field.values.rows());
  add("node_id", "Int64", 1);
  list << "    </PPointData>\n    <PPoints>\n";
  add("points", "Float64", 3);
  list << "    </PPoints>\n";
  for (const std::string& piece : pieces)
    list << "    <Piece Source=\"" << std::filesystem::path(piece).filename().string() << "\"/>\n";
  list << "  </PUnstructuredGrid>\n</VTKFile>\n";
  std::string bytes = list.str();
  write_file(file, bytes);
  return bytes;
}

}  // namespace testbed::meshing
